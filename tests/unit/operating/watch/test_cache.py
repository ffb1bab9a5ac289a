"""Indexes, and the numbers that tell what has changed."""

from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.factories import app_body, domain_claim, make_app, make_deployment, make_node, make_pod

from robotapp_api.model.names import Annotation, Label
from robotapp_claims.rules.objects import Claim
from robotapp_operator.plan.render.instance_object import AppInstance, wanted_object
from robotapp_operator.plan.spec.objects import Deployment, Pod, ReplicaSet
from robotapp_operator.watch.cache import MOST_ENDED, Cache
from robotapp_operator.watch.nodes import Nodes

UID = "uid-1"


def deployment(name: str, instance: str) -> Deployment:
    found = make_deployment(name)
    found.metadata.labels[Label.INSTANCE] = instance
    return found


def pod(name: str, instance: str, node: str = "") -> Pod:
    return make_pod(name, node=node, metadata={"labels": {Label.INSTANCE.value: instance}})


@pytest.fixture
def cache() -> Cache:
    made = Cache()
    made.update_app(app_body())
    return made


def test_children_are_found_by_instance(cache: Cache) -> None:
    for name, instance in (("a1", "a"), ("a2", "a"), ("b1", "b")):
        cache.deployments.put(UID, name, deployment(name, instance))
    assert set(cache.deployments.of_instance(UID, "a")) == {"a1", "a2"}
    assert cache.instance_keys(UID) == cache.running_instances(UID) == {"a", "b"}
    cache.deployments.drop(UID, "b1")
    cache.deployments.drop(UID, "never there")
    assert cache.instance_keys(UID) == {"a"}
    assert not cache.deployments.of_instance(UID, "b")
    assert not cache.deployments.of_instance("nobody", "a")


def test_a_child_whose_label_is_edited_moves_to_the_other_instance(cache: Cache) -> None:
    cache.deployments.put(UID, "x", deployment("x", "a"))
    before = cache.version_of(UID, "a"), cache.version_of(UID, "b")
    cache.deployments.put(UID, "x", deployment("x", "b"))
    assert cache.instance_keys(UID) == {"b"}
    assert all(
        now > then for then, now in zip(before, (cache.version_of(UID, "a"), cache.version_of(UID, "b")), strict=True)
    )


@given(
    st.lists(
        st.tuples(st.sampled_from("pqr"), st.none() | st.tuples(st.sampled_from("ab"), st.sampled_from(["", "n", "m"])))
    )
)
def test_pods_are_found_by_node_whatever_happened_to_them(steps: list[tuple[str, tuple[str, str] | None]]) -> None:
    cache, truth = Cache(), dict[str, tuple[str, str]]()
    for name, state in steps:
        if state is None:
            cache.pods.drop(UID, name)
            truth.pop(name, None)
        else:
            cache.pods.put(UID, name, pod(name, *state))
            truth[name] = state
    for node in ("n", "m"):
        assert cache.pods.on_node(node) == {(UID, instance) for instance, where in truth.values() if where == node}
    for instance in "ab":
        assert set(cache.pods.of_instance(UID, instance)) == {
            name for name, (own, _) in truth.items() if own == instance
        }
    assert cache.pods.on_node("") == set()


def test_every_change_of_an_instance_has_a_new_number_and_others_keep_theirs(cache: Cache) -> None:
    claim = domain_claim(7, instance="a")
    labels = {Label.APP_UID.value: UID, Label.INSTANCE.value: "a"}
    replica_set = msgspec.convert({"metadata": {"uid": "rs", "namespace": "default", "labels": labels}}, ReplicaSet)
    steps = [
        lambda: cache.deployments.put(UID, "x", deployment("x", "a")),
        lambda: cache.pods.put(UID, "p", pod("p", "a")),
        lambda: cache.pods.put(UID, "p", pod("p", "a", "n")),
        lambda: cache.claims.put(UID, claim.name, claim),
        lambda: cache.put_replica_set(replica_set),
        lambda: cache.drop_replica_set(replica_set),
        lambda: cache.claims.drop(UID, claim.name),
        lambda: cache.pods.drop(UID, "p"),
    ]
    other = cache.version_of(UID, "b")
    for step in steps:
        before = cache.version_of(UID, "a")
        step()
        assert cache.version_of(UID, "a") > before
    assert cache.version_of(UID, "b") == other


def test_nothing_is_numbered_for_apps_that_are_not_known(cache: Cache) -> None:
    cache.pods.put("stranger", "p", pod("p", "a"))
    assert cache.version_of("stranger", "a") == 0
    cache.forget_app(UID)
    assert cache.version_of(UID, "a") == 0


def test_an_answer_about_an_app_that_was_deleted_meanwhile_brings_no_app_back(cache: Cache) -> None:
    cache.forget_app(UID)
    assert cache.update_app(app_body()).uid == UID
    assert UID not in cache.apps
    assert cache.update_app(app_body(uid="successor")).uid in cache.apps


def device_claim(uid: str) -> Claim:
    holder = {"apiVersion": "v1", "kind": "Pod", "namespace": "default", "name": "x", "uid": uid}
    return msgspec.convert(
        {
            "metadata": {"name": "dev.n.can0"},
            "spec": {"device": {"node": "n", "type": "can", "id": "can0"}, "holder": holder},
        },
        Claim,
    )


def test_devices_have_another_version_when_one_changes_hands(cache: Cache) -> None:
    versions = [cache.devices_version]
    cache.claims.put("t", "dev.n.can0", device_claim("t"))
    versions.append(cache.devices_version)
    cache.claims.put("t", "dev.n.can0", device_claim("t"))
    assert cache.devices_version == versions[-1]
    cache.claims.put(UID, "dds.default.c.7", domain_claim(7))
    assert cache.devices_version == versions[-1], "a domain is no device"
    cache.claims.drop("t", "dev.n.can0")
    versions.append(cache.devices_version)
    assert len(set(versions)) == 3
    assert set(cache.claims.by_name) == {"dds.default.c.7"}


# RobotAppInstances


def stored(version: int, *, uid: str = "u", app_uid: str = UID) -> AppInstance:
    body: dict[str, Any] = wanted_object(make_app(uid=app_uid), "a")
    body["metadata"] |= {"uid": uid, "resourceVersion": str(version)}
    return msgspec.convert(body, AppInstance)


def test_of_two_copies_the_newer_stays_and_an_echo_is_no_news(cache: Cache) -> None:
    assert cache.put_instance_object(stored(5))
    assert not cache.put_instance_object(stored(5))
    assert not cache.put_instance_object(stored(4))
    assert cache.put_instance_object(stored(6))
    (item,) = cache.instance_objects.of_instance(UID, "a").values()
    assert item.version_number == 6


def test_a_successor_of_the_name_replaces_its_predecessor_wherever_it_was_found(cache: Cache) -> None:
    cache.put_instance_object(stored(5))
    assert cache.put_instance_object(stored(4, uid="v", app_uid="uid-2")), "another object, whatever its version"
    assert not cache.instance_objects.of_instance(UID, "a")
    cache.drop_instance_object(stored(5))
    assert cache.instance_objects.of_instance("uid-2", "a"), "the end of the predecessor is not its own"
    cache.drop_instance_object(stored(4, uid="v", app_uid="uid-2"))
    assert cache.instance_object_named == {}


def test_an_answer_that_comes_after_the_deletion_brings_nothing_back(cache: Cache) -> None:
    cache.put_instance_object(stored(5))
    cache.drop_instance_object(stored(5))
    assert not cache.put_instance_object(stored(6))
    assert cache.instance_object_named == {}
    assert not cache.instance_objects.of_instance(UID, "a")
    assert cache.put_instance_object(stored(7, uid="v")), "its successor"


def test_the_ends_that_are_remembered_are_bounded(cache: Cache) -> None:
    for number in range(MOST_ENDED + 1):
        cache.drop_instance_object(stored(1, uid=f"u{number}"))
    assert not cache.put_instance_object(stored(2, uid="u1"))
    assert cache.put_instance_object(stored(2, uid="u0"))


# Nodes


def test_nodes_tell_whose_they_are_and_whether_they_are_ready_apart() -> None:
    nodes = Nodes()
    nodes["n"] = make_node("n", robot="r")
    nodes["n"] = make_node("n", robot="r")
    assert (nodes.identity_version, nodes.readiness_version) == (1, 1)
    nodes["n"] = make_node("n", robot="r", ready=False)
    assert (nodes.identity_version, nodes.readiness_version) == (1, 2)
    nodes["n"] = make_node("n", robot="s", ready=False)
    nodes["n"] = make_node("n", robot="s", ready=False, annotations={Annotation.ALLOWED_NAMESPACES: "x"})
    assert (nodes.identity_version, nodes.readiness_version) == (3, 2)
    assert repr(nodes) == "<Nodes: 1, version 3.2>"


def test_the_computers_of_a_robot_are_found() -> None:
    nodes = Nodes()
    for name in ("n", "m"):
        nodes[name] = make_node(name, robot="r")
    assert nodes.of_robot("r") == {"n", "m"}
    nodes["m"] = make_node("m")
    assert nodes.of_robot("r") == {"n"}
    del nodes["n"]
    assert nodes.of_robot("r") == frozenset()
    assert list(nodes) == ["m"]


def test_an_answer_holds_for_one_spec_and_one_version(cache: Cache) -> None:
    app, asked = make_app(), list[str]()

    def ask(who: Any, version: int) -> int:
        def work_out() -> int:
            asked.append(who.uid)
            return version

        found: int = cache.answers.get(who, "question", version, work_out)
        return found

    assert [ask(app, 1), ask(app, 1), ask(app, 2)] == [1, 1, 2]
    assert ask(make_app(), 2) == 2
    assert len(asked) == 3
    cache.forget_app(app.uid)
    ask(app, 2)
    assert len(asked) == 4
