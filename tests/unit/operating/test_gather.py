"""From caches to facts."""

from typing import Any

import msgspec
from tests.support.claims_objects import pool_json
from tests.support.factories import (
    VERSION,
    after,
    app_body,
    component,
    domain_claim,
    make_app,
    make_pod,
    robots,
)

from robotapp_api.claims.domain import DomainOutcome
from robotapp_api.claims.identity import id_order
from robotapp_api.claims.objects import Pool
from robotapp_api.model.names import Reason
from robotapp_operator.cache import Cache
from robotapp_operator.gather import app_facts, cached_domain, params_file, params_files, wanted_instances
from robotapp_operator.plan.changes import Observed, plan, wanted_children
from robotapp_operator.plan.objects import ConfigMap, Deployment, ReplicaSet
from robotapp_operator.plan.wish import App, Domain, wish_of

EACH = {"selector": {"matchExpressions": [{"key": "robotics.io/robot", "operator": "Exists"}]}}


def config_map(**data: str) -> ConfigMap:
    return msgspec.convert({"metadata": {"name": "drv", "namespace": "default"}, "data": data}, ConfigMap)


def with_children(cache: Cache, app: App, robot: str = "", *, number: int = 7) -> dict[Any, Observed]:
    wish = wish_of(app, robot)
    wanted = wanted_children(wish, domain=Domain(number, f"dds.default.c.{number}"), params={}, running=True)
    found = after(plan(app, wanted, {}, version=VERSION, settled={}), {}, app)
    for ref, item in found.items():
        index: Any = cache.deployments if isinstance(item, Deployment) else cache.services
        index.put(app.uid, f"default/{ref.name}", item)
    return found


def test_the_cached_domain_is_the_one_standing_claim() -> None:
    cache = Cache()
    app = make_app()
    assert cached_domain(app, "", cache, None) is None
    cache.claims.put(app.uid, "a", domain_claim(7))
    assert cached_domain(app, "", cache, None) == Domain(7, "dds.default.c.7")


def test_whatever_is_not_plain_goes_to_the_api_server() -> None:
    app = make_app()
    for claims in (
        [domain_claim(7, phase="Draining")],
        [domain_claim(7, pool="other")],
        [domain_claim(7, instance="amr-07")],
    ):
        cache = Cache()
        for claim in claims:
            cache.claims.put(app.uid, claim.name, claim)
        assert cached_domain(app, "", cache, None) is None
    cache = Cache()
    cache.claims.put(app.uid, "a", domain_claim(7))
    assert cached_domain(make_app(dds={"domain": 8}), "", cache, None) is None
    assert cached_domain(make_app(dds={"isolation": "Discovery"}), "", cache, None) is None


def test_of_two_claims_the_domain_is_the_one_the_spec_then_the_templates_then_the_hash_choose() -> None:
    """Moving 5 -> 7 an instance holds both until its last pod has left 5, and has a domain all the time."""
    app, cache = make_app(), Cache()
    for number in (5, 7):
        cache.claims.put(app.uid, str(number), domain_claim(number))
    first, second = id_order((5, 7), app.uid, "")
    assert cached_domain(app, "", cache, None) == Domain(first, f"dds.default.c.{first}")
    with_children(cache, app, number=second)
    assert cached_domain(app, "", cache, None) == Domain(second, f"dds.default.c.{second}")
    for number in (5, 7):
        found = cached_domain(make_app(dds={"domain": number}), "", cache, None)
        assert found == Domain(number, f"dds.default.c.{number}")


def test_the_same_id_of_two_pools_is_two_domains() -> None:
    app, cache = make_app(dds={"domain": 7, "pool": "field"}), Cache()
    for pool in ("default", "field", "attic"):
        cache.claims.put(app.uid, pool, domain_claim(7, pool=pool))
    assert cached_domain(app, "", cache, None) == Domain(7, "dds.field.c.7")


def test_an_unclaimed_domain_is_remembered_from_the_last_answer_while_the_pool_shares_it() -> None:
    app, cache = make_app(dds={"isolation": "Discovery"}), Cache()
    cache.pools["default"] = msgspec.convert(pool_json("1-80", sharedIds="90-91"), Pool)
    answer = DomainOutcome(Reason.ALLOCATED, "shared", id=90)
    assert cached_domain(app, "", cache, answer) == Domain(90, "")
    for stale in (None, DomainOutcome(Reason.ALLOCATED, "claimed, before the spec was edited", id=5)):
        assert cached_domain(app, "", cache, stale) is None
    cache.pools["default"] = msgspec.convert(pool_json("1-80", sharedIds="91"), Pool)
    assert cached_domain(app, "", cache, answer) is None


# shareWith


def sharing(cache: Cache, *apps: tuple[str, str]) -> dict[str, App]:
    """Apps by name, each with the name it shares with or ""."""
    found = {}
    for name, other in apps:
        dds = {"dds": {"shareWith": [{"name": other}]}} if other else {}
        record = cache.update_app(app_body(name, uid=f"uid-{name}", **dds))
        assert record.app is not None
        found[name] = record.app
    return found


ANSWER = DomainOutcome(Reason.ALLOCATED, "joined", id=5, claim="dds.default.c.5")


def test_a_sharer_follows_its_owners_claim_whatever_it_was_told_before() -> None:
    cache = Cache()
    apps = sharing(cache, ("mapper", ""), ("teleop", "mapper"))
    assert cached_domain(apps["teleop"], "", cache, ANSWER) is None
    cache.claims.put("uid-mapper", "c", domain_claim(5, uid="uid-mapper"))
    assert cached_domain(apps["teleop"], "", cache, None) == Domain(5, "dds.default.c.5")
    with_children(cache, apps["mapper"], number=7)
    cache.claims.put("uid-mapper", "d", domain_claim(7, uid="uid-mapper"))
    assert cached_domain(apps["teleop"], "", cache, ANSWER) == Domain(7, "dds.default.c.7")
    for phase, name in (("Draining", "d"), ("Draining", "c")):
        cache.claims.put("uid-mapper", name, domain_claim({"c": 5, "d": 7}[name], uid="uid-mapper", phase=phase))
    assert cached_domain(apps["teleop"], "", cache, ANSWER) is None


def test_a_ring_has_one_leader_and_nobody_knows_where_a_broken_chain_leads() -> None:
    cache = Cache()
    apps = sharing(cache, ("a", "b"), ("b", "a"), ("lost", "nobody"))
    cache.claims.put("uid-a", "c", domain_claim(5, uid="uid-a"))
    assert cached_domain(apps["a"], "", cache, None) == cached_domain(apps["b"], "", cache, None)
    assert cached_domain(apps["a"], "", cache, None) == Domain(5, "dds.default.c.5")
    assert cached_domain(apps["lost"], "", cache, ANSWER) is None


def test_a_sharers_status_shows_the_last_answer_until_its_owner_is_in_the_caches() -> None:
    cache = Cache()
    body = app_body(dds={"shareWith": [{"name": "mapper"}]})
    (instance,) = facts_of(cache, body, outcomes={"": ANSWER}).instances
    assert (instance.domain, instance.refusal) == (5, None)


def test_who_follows_an_app_is_known_step_by_step_and_forgotten_with_it() -> None:
    cache = Cache()
    sharing(cache, ("b", "a"), ("c", "b"), ("d", ""))
    assert cache.sharing.followers(("default", "a")) == {"uid-b", "uid-c"}
    sharing(cache, ("a", ""))
    assert cache.sharing.followers(("default", "b")) == {"uid-c"}
    cache.update_app(app_body("c", uid="uid-c", generation=2))
    assert cache.sharing.followers(("default", "a")) == {"uid-b"}
    cache.forget_app("uid-b")
    assert cache.sharing.followers(("default", "a")) == set()
    assert cache.sharing.named(("default", "b")) is None
    assert repr(cache.sharing) == "<Sharing: 0 of 3 apps are named by others>"


def test_of_an_app_and_its_successor_the_newer_one_answers_to_the_name() -> None:
    cache = Cache()
    for uid in ("uid-1", "uid-2"):
        cache.update_app(app_body(uid=uid))
    cache.forget_app("uid-1")
    found = cache.sharing.named(("default", "teleop"))
    assert found is not None
    assert found.uid == "uid-2"


def test_any_follows_the_claim_until_it_runs_and_then_stays() -> None:
    app = make_app(robots=EACH | {"instances": "Any"})
    cache = Cache()
    cache.nodes.update(robots("a", "b", "c"))
    for robot in ("b", "c"):
        cache.claims.put(app.uid, "x", domain_claim(7, instance=robot))
        assert wanted_instances(app, cache)[0].robot == robot
    with_children(cache, app, "b")
    assert wanted_instances(app, cache)[0].robot == "b"


def test_the_parameters_key_is_the_robots_own_then_the_common_then_the_only_one() -> None:
    params = (
        make_app(component("a", args=["x"], params={"configMap": "drv", "perRobot": True})).spec.components[0].params
    )
    assert params is not None
    assert params_file(params, "amr-07", config_map(**{"amr-07.yaml": "1", "params.yaml": "2"})).key == "amr-07.yaml"
    assert params_file(params, "amr-08", config_map(**{"amr-07.yaml": "1", "params.yaml": "2"})).key == "params.yaml"
    assert params_file(params, "", config_map(**{"drv.yaml": "1"})).key == "drv.yaml"


def test_the_hash_follows_the_content_and_is_empty_without_it() -> None:
    params = make_app(component("a", args=["x"], params={"configMap": "drv"})).spec.components[0].params
    assert params is not None
    one, two = (params_file(params, "", config_map(**{"params.yaml": text})).hash for text in "12")
    assert one != two
    assert params_file(params, "", None).hash == ""


def test_only_components_with_parameters_have_a_file() -> None:
    app = make_app(component("a", args=["x"], params={"configMap": "drv"}), component("b"))
    cache = Cache()
    cache.config_maps["default/drv"] = config_map(**{"params.yaml": "1"})
    assert set(params_files(app, "", cache)) == {"a"}


def facts_of(cache: Cache, body: dict[str, Any], **changes: Any) -> Any:
    given: dict[str, Any] = {"outcomes": {}, "troubles": {}, "held": {}, "now": "t", "latency_rested": True}
    return app_facts(cache.update_app(body), cache, **(given | changes))


def test_pods_belong_to_a_component_through_the_chain_of_owners() -> None:
    cache = Cache()
    app = make_app()
    children = with_children(cache, app)
    driver = next(item for ref, item in children.items() if "driver" in ref.name)
    for name, owner in (("rs", driver.metadata.uid), ("alien", "somebody")):
        meta = {"name": name, "uid": name, "ownerReferences": [{"uid": owner, "controller": True}]}
        cache.put_replica_set(msgspec.convert({"metadata": meta}, ReplicaSet))
    for name, owner in (("p", "rs"), ("imposter", "alien")):
        owners = [{"uid": owner, "controller": True}]
        cache.pods.put(app.uid, name, make_pod(name, node=f"on-{name}", metadata={"ownerReferences": owners}))
    facts = facts_of(cache, app_body())
    nodes = {view.name: view.nodes for view in facts.instances[0].components}
    assert nodes == {"operator": (), "driver": ("on-p",)}


def test_a_refusal_is_shown_until_a_claim_stands() -> None:
    cache = Cache()
    refused = {"": DomainOutcome(Reason.DOMAIN_EXHAUSTED, "full")}
    assert facts_of(cache, app_body(), outcomes=refused).instances[0].refusal == (Reason.DOMAIN_EXHAUSTED, "full")
    cache.claims.put("uid-1", "a", domain_claim(7))
    (instance,) = facts_of(cache, app_body(), outcomes=refused).instances
    assert instance.refusal is None
    assert instance.domain == 7
    assert instance.claims == ("dds.default.c.7",)


def test_an_unreadable_app_has_no_facts_and_a_refused_one_no_instances() -> None:
    cache = Cache()
    assert facts_of(cache, app_body(components="none")) is None
    refused = facts_of(cache, app_body(uid="uid-2", ros={"distro": "humbel"}))
    assert refused.problems
    assert refused.instances == ()


def test_children_of_another_owner_are_not_ours() -> None:
    cache = Cache()
    other = make_app(uid="uid-2")
    for item in with_children(cache, other).values():
        if isinstance(item, Deployment):
            cache.deployments.put("uid-1", item.metadata.name, item)
    (instance,) = facts_of(cache, app_body()).instances
    assert not any(view.exists for view in instance.components)


def test_discovery_counts_as_ready_with_one_of_its_servers() -> None:
    cache = Cache()
    app = make_app()
    children = with_children(cache, app)
    assert facts_of(cache, app_body()).instances[0].infrastructure_ready is False
    first = next(item for ref, item in children.items() if "discovery" in ref.name and isinstance(item, Deployment))
    assert isinstance(first, Deployment)
    first.status.ready_replicas = 1
    assert facts_of(cache, app_body()).instances[0].infrastructure_ready is True


def test_the_cache_forgets_what_is_dropped() -> None:
    cache = Cache()
    app = make_app()
    with_children(cache, app)
    assert cache.instance_keys(app.uid) == {""}
    for key in list(cache.deployments.of(app.uid)):
        cache.deployments.drop(app.uid, key)
    for key in list(cache.services.of(app.uid)):
        cache.services.drop(app.uid, key)
    cache.services.drop(app.uid, "never there")
    assert cache.instance_keys(app.uid) == set()
    assert repr(cache) == "<Cache: 0 apps, 0 nodes, 0 pods>"
