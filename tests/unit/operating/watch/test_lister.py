"""From caches to facts."""

from collections.abc import Callable
from functools import partial
from typing import Any

import msgspec
import pytest
from tests.support.claims.objects import pool_json
from tests.support.factories import (
    VERSION,
    after,
    app_body,
    component,
    domain_claim,
    make_app,
    make_node,
    make_pod,
    robots,
)

from robotapp_api.model.names import Reason
from robotapp_claims.rules.domain import DomainOutcome
from robotapp_claims.rules.identity import claim_name_device, id_order
from robotapp_claims.rules.objects import Claim, Pool
from robotapp_client.api.times import utc_now
from robotapp_operator.plan.diff.diff import Observed, plan, wanted_children
from robotapp_operator.plan.spec.desired import App, Domain, desired_of
from robotapp_operator.plan.spec.objects import ConfigMap, Deployment, ReplicaSet, Telemetry
from robotapp_operator.plan.status.facts import InstanceFacts
from robotapp_operator.watch import lister
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.facts.instance_facts import instance_facts
from robotapp_operator.watch.lister import cached_domain, problems_now, wanted_instances

EACH = {"nodeSelector": {"matchExpressions": [{"key": "robotics.io/robot", "operator": "Exists"}]}}


def with_children(cache: Cache, app: App, robot: str = "", *, number: int = 7) -> dict[Any, Observed]:
    desired = desired_of(app, robot)
    wanted = wanted_children(desired, domain=Domain(number, f"dds.default.c.{number}"), parameters={}, running=True)
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
    assert cached_domain(make_app(ros2={"domain": 8}), "", cache, None) is None
    assert cached_domain(make_app(ros2={"isolation": "Discovery"}), "", cache, None) is None


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
        found = cached_domain(make_app(ros2={"domain": number}), "", cache, None)
        assert found == Domain(number, f"dds.default.c.{number}")


def test_the_same_id_of_two_pools_is_two_domains() -> None:
    app, cache = make_app(ros2={"domain": 7, "pool": "field"}), Cache()
    for pool in ("default", "field", "attic"):
        cache.claims.put(app.uid, pool, domain_claim(7, pool=pool))
    assert cached_domain(app, "", cache, None) == Domain(7, "dds.field.c.7")


def test_an_unclaimed_domain_is_remembered_from_the_last_answer_while_the_pool_shares_it() -> None:
    app, cache = make_app(ros2={"isolation": "Discovery"}), Cache()
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
        ros2 = {"ros2": {"shareWith": [{"name": other}]}} if other else {}
        record = cache.update_app(app_body(name, uid=f"uid-{name}", **ros2))
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
    body = app_body(ros2={"shareWith": [{"name": "mapper"}]})
    instance = facts_of(cache, body, outcome=ANSWER)
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
    app = make_app(robots=EACH | {"assignment": "Any"})
    cache = Cache()
    cache.nodes.update(robots("a", "b", "c"))
    for robot in ("b", "c"):
        cache.claims.put(app.uid, "x", domain_claim(7, instance=robot))
        assert wanted_instances(app, cache)[0].robot == robot
    with_children(cache, app, "b")
    assert wanted_instances(app, cache)[0].robot == "b"


def facts_of(cache: Cache, body: dict[str, Any], *, outcome: DomainOutcome | None = None) -> InstanceFacts:
    """Of the only instance."""
    app = cache.update_app(body).app
    assert app is not None
    (instance,) = wanted_instances(app, cache)
    return instance_facts(app, instance, cache, outcome=outcome, trouble=None, held=(), now_s=0.0, now=utc_now())


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
    nodes = {view.name: view.nodes for view in facts_of(cache, app_body()).components}
    assert nodes == {"operator": (), "driver": ("on-p",)}


def test_a_refusal_is_shown_until_a_claim_stands() -> None:
    cache = Cache()
    refused = DomainOutcome(Reason.DOMAIN_EXHAUSTED, "full")
    assert facts_of(cache, app_body()).undecided
    instance = facts_of(cache, app_body(), outcome=refused)
    assert (instance.refusal, instance.undecided) == ((Reason.DOMAIN_EXHAUSTED, "full"), False)
    cache.claims.put("uid-1", "a", domain_claim(7))
    instance = facts_of(cache, app_body(), outcome=refused)
    assert instance.refusal is None
    assert instance.domain == 7
    assert instance.claims == ("dds.default.c.7",)


def test_children_of_another_owner_are_not_ours() -> None:
    cache = Cache()
    other = make_app(uid="uid-2")
    for item in with_children(cache, other).values():
        if isinstance(item, Deployment):
            cache.deployments.put("uid-1", item.metadata.name, item)
    assert not facts_of(cache, app_body()).exists


def test_discovery_counts_as_ready_with_one_of_its_servers() -> None:
    cache = Cache()
    app = make_app()
    children = with_children(cache, app)
    assert facts_of(cache, app_body()).infrastructure_ready is False
    first = next(item for ref, item in children.items() if "discovery" in ref.name and isinstance(item, Deployment))
    assert isinstance(first, Deployment)
    first.status.ready_replicas = 1
    assert facts_of(cache, app_body()).infrastructure_ready is True


def test_helpers_are_seen_with_their_image_and_explained_as_components_are() -> None:
    cache = Cache()
    children = with_children(cache, make_app())
    server = next(item for ref, item in children.items() if "discovery" in ref.name and isinstance(item, Deployment))
    meta = {"name": "rs", "uid": "rs", "ownerReferences": [{"uid": server.metadata.uid, "controller": True}]}
    cache.put_replica_set(msgspec.convert({"metadata": meta}, ReplicaSet))
    owners = [{"uid": "rs", "controller": True}]
    pull = ("ImagePullBackOff", "Back-off pulling image")
    cache.pods.put("uid-1", "p", make_pod("p", node="edge-1", waiting=pull, metadata={"ownerReferences": owners}))
    helpers = {helper.part.name: helper for helper in facts_of(cache, app_body()).helpers}
    assert {name: helper.part.image for name, helper in helpers.items()} == {
        "discovery-0": "ros:humble-ros-base",
        "discovery-1": "ros:humble-ros-base",
    }
    assert helpers["discovery-0"].view.reason == Reason.IMAGE_PULL
    assert helpers["discovery-0"].view.node == "edge-1"
    assert helpers["discovery-1"].view.reason is None


def test_a_missing_parameter_file_is_named() -> None:
    cache = Cache()
    file = {"configMapKeyRef": {"name": "drv", "key": "params.yaml"}}
    body = app_body(components=[component("driver", args=["x"], parameters=[file])])
    with_children(cache, make_app(component("driver", args=["x"], parameters=[file])))
    (view,) = facts_of(cache, body).components
    assert view.message.startswith("there is no ConfigMap drv")
    cache.config_maps["default/drv"] = msgspec.convert(
        {"metadata": {"name": "drv", "namespace": "default"}, "data": {"params.yaml": "1"}}, ConfigMap
    )
    (view,) = facts_of(cache, body).components
    assert view.message == ""


CAN = {"metadata": {"name": "n"}, "status": {"devices": [{"id": "can0", "type": "can"}]}}
HELD = {
    "metadata": {"name": claim_name_device("n-a", "can0")},
    "spec": {
        "device": {"node": "n-a", "type": "can", "id": "can0"},
        "holder": {"apiVersion": "v1", "kind": "Pod", "namespace": "default", "name": "thief", "uid": "t"},
    },
}


@pytest.mark.parametrize("tiers", [["Robot"], ["Robot", "Edge"], []])
def test_who_has_the_device_of_a_robot_is_found_among_its_own_nodes(tiers: list[str]) -> None:
    cache = Cache()
    cache.nodes.update(robots("a", "b"))
    bus = component("driver", runsOn=tiers, devices=[{"name": "bus", "type": "can"}])
    one = {"nodeSelector": {"matchLabels": {"robotics.io/robot": "a"}}}
    body = app_body(components=[bus], robots=one)
    for node in ("n-a", "n-b"):
        cache.telemetry[node] = msgspec.convert(CAN, Telemetry)
    assert facts_of(cache, body).busy == ""
    claim = msgspec.convert(HELD, Claim)
    cache.claims.put("t", claim.name, claim)
    assert "held by pod default/thief" in facts_of(cache, body).busy


# Answers that depend on all nodes


def test_only_devices_that_our_scheduler_claims_are_wanted() -> None:
    devices = [
        {"name": "gpu", "type": "gpu"},
        {"name": "tap", "type": "can", "sharing": "Cluster"},
        {"name": "cam", "type": "usb"},
    ]
    assert facts_of(Cache(), app_body(components=[component(devices=devices)])).devices_wanted == 1


def count_questions(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the rules that were asked, each time."""
    asked: list[str] = []

    def counted(name: str, real: Callable[..., Any], *args: Any, **kwargs: Any) -> Any:
        asked.append(name)
        return real(*args, **kwargs)

    for name in ("instances_of", "problems_alone", "problems_with"):
        monkeypatch.setattr(lister, name, partial(counted, name, getattr(lister, name)))
    return asked


def test_which_instances_there_are_is_worked_out_once_for_all_keys(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = count_questions(monkeypatch)
    app, cache = make_app(robots=EACH), Cache()
    cache.nodes.update(robots("a", "b"))
    for _ in range(3):
        assert [instance.robot for instance in wanted_instances(app, cache)] == ["a", "b"]
        assert problems_now(app, cache) == ()
    assert asked == ["instances_of", "problems_alone", "problems_with"]
    cache.nodes["n-b"] = make_node("n-b", robot="b", tier="robot", ready=False)
    wanted_instances(app, cache)
    assert len(asked) == 3, "who has no say in it asks nobody"
    del cache.nodes["n-b"]
    assert [instance.robot for instance in wanted_instances(app, cache)] == ["a"]
    assert problems_now(app, cache) == ()
    assert asked[3:] == ["instances_of", "problems_with"], "the spec itself is read once, whatever nodes come and go"
    other = make_app(robots={"nodeSelector": {"matchLabels": {"robotics.io/robot": "z"}}}, generation=2)
    assert wanted_instances(other, cache) == ()
    assert [problem.reason for problem in problems_now(other, cache)] == [Reason.NO_MATCHING_ROBOT]


def test_any_robot_is_chosen_anew_when_one_is_claimed_or_out_of_reach() -> None:
    app, cache = make_app(robots=EACH | {"assignment": "Any"}), Cache()
    cache.nodes.update(robots("a", "b"))
    (first,) = wanted_instances(app, cache)
    cache.nodes[first.node] = make_node(first.node, robot=first.robot, ready=False)
    (second,) = wanted_instances(app, cache)
    assert second.robot != first.robot
    cache.claims.put(app.uid, "c", domain_claim(7, instance=first.robot))
    assert wanted_instances(app, cache) == (first,)


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


BUS = [{"name": "bus", "type": "can"}]


def test_a_component_that_waits_is_said_to_and_its_devices_are_not_wanted_yet() -> None:
    parts = [component("driver", devices=BUS), component("arm", devices=BUS, dependsOn=[{"component": "driver"}])]
    found = facts_of(Cache(), app_body(components=parts))
    assert [(view.name, view.waits, view.message) for view in found.components] == [
        ("driver", False, ""),
        ("arm", True, "waits until driver is Ready (dependsOn)"),
    ]
    assert found.devices_wanted == 1


def test_a_suspended_component_wants_no_devices_and_its_edges_are_not_judged() -> None:
    edges = [{"topic": "/joints", "from": "arm", "to": "driver", "latency": {"budget": "30ms"}}]
    parts = [component("driver"), component("arm", devices=BUS, replicas=0)]
    found = facts_of(Cache(), app_body(components=parts, edges=edges))
    assert (found.devices_wanted, found.edges) == (0, ())
    assert [view.name for view in found.wanted] == ["driver"]
