"""From caches to facts."""

from typing import Any

import msgspec
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
        [domain_claim(7), domain_claim(8)],
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


def test_a_shared_domain_is_remembered_from_the_last_answer() -> None:
    app = make_app(dds={"isolation": "Discovery"})
    outcome = DomainOutcome(Reason.ALLOCATED, "shared", id=90)
    assert cached_domain(app, "", Cache(), outcome) == Domain(90, "")


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
