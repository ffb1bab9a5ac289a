import dataclasses

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.claims.objects import (
    app_holder,
    deployment,
    device_claim,
    domain_claim,
    labels,
    pod,
    pod_spec,
    replica_set,
)

from robotapp_claims.rules.objects import Container, Deployment, EnvVar, Pod, PodSpec, ReplicaSet
from robotapp_claims.rules.usage import AppRef, named_ids, owner_as_used, pod_as_used, unclear_domains, usage_of

seven = domain_claim(7)


@pytest.mark.parametrize(
    ("objects", "used"),
    [
        ({"deployments": [deployment(7)]}, True),
        ({"deployments": [deployment(7, replicas=0)]}, True),
        ({"deployments": [deployment(8)]}, False),
        ({"deployments": [deployment()]}, False),
        ({"deployments": [deployment("seven")]}, False),
        ({"deployments": [deployment(7, of=labels("app-2"))]}, False),
        ({"deployments": [deployment(7, of=labels(instance="amr-1"))]}, False),
        ({"deployments": [deployment(7, of={})]}, False),
        ({"replica_sets": [replica_set(7)]}, True),
        ({"replica_sets": [replica_set(7, wanted=0, present=1)]}, True),
        ({"replica_sets": [replica_set(7, wanted=1, present=0)]}, True),
        ({"replica_sets": [replica_set(7, wanted=0, present=0)]}, False),
        ({"pods": [pod(7)]}, True),
        ({"pods": [pod(7, node="edge-1", phase="Running")]}, True),
        ({"pods": [pod(7, phase="Succeeded")]}, False),
        ({"pods": [pod(7, phase="Failed")]}, False),
        ({"pods": [pod(8, 7)]}, True),
        ({"pods": [pod(7, of={})]}, False),
    ],
)
def test_an_id_is_used_by_what_names_it_and_can_still_run(objects: dict[str, list[object]], used: bool) -> None:
    assert usage_of(**objects).uses(seven, app_exists=True) is used  # type: ignore[arg-type]  # a table of keyword arguments


def test_an_app_that_names_the_owners_claim_is_to_be_asked_whether_it_shares() -> None:
    sharer = labels("app-2", app="mapper")
    named = usage_of(deployments=[deployment(7, of=sharer, claim=seven.name)])
    assert named.sharers(seven) == {AppRef("team", "mapper", "app-2")}
    assert not named.uses(seven, app_exists=True)
    assert not usage_of(deployments=[deployment(7, of=sharer)]).sharers(seven)


def test_a_live_pod_of_the_namespace_that_names_the_claim_keeps_it() -> None:
    sharer = pod(7, of=labels("app-2"), annotations={"robotics.io/domain-claim": seven.name})
    assert usage_of(pods=[sharer]).uses(seven, app_exists=False)


def test_an_annotation_that_the_environment_does_not_back_keeps_nothing() -> None:
    assert not usage_of(deployments=[deployment(8, of=labels("app-2"), claim=seven.name)]).sharers(seven)


def test_taking_the_annotation_off_a_running_pod_does_not_free_its_id() -> None:
    marked = pod(7, annotations={"robotics.io/domain-claim": "dds.default.c.8"})
    assert usage_of(pods=[marked]).uses(seven, app_exists=True)


def test_a_device_claim_is_never_used_as_a_domain() -> None:
    assert not usage_of(deployments=[deployment(7)]).uses(device_claim(), app_exists=True)


def test_deployments_say_which_ids_are_preferred_but_pods_do_not() -> None:
    usage = usage_of(deployments=[deployment(7), deployment(8, name="b")], pods=[pod(9)])
    assert usage.named_by_deployments(app_holder()) == {7, 8}
    assert usage.named_by_deployments(app_holder("app-2")) == frozenset()


def test_init_containers_count_too() -> None:
    spec = pod_spec(3)
    assert named_ids(type(spec)(init_containers=spec.containers)) == {3}


numbers = st.integers(0, 4)
owners = st.sampled_from([labels("a"), labels("b"), labels("a", "r"), {}])
objects = st.one_of(
    st.builds(lambda n, of: deployment(n, of=of), numbers, owners),
    st.builds(
        lambda n, of, w, p: replica_set(n, of=of, wanted=w, present=p),
        numbers,
        owners,
        st.integers(0, 1),
        st.integers(0, 1),
    ),
    st.builds(
        lambda n, of, phase: pod(n, of=of, phase=phase),
        numbers,
        owners,
        st.sampled_from(["Pending", "Running", "Failed"]),
    ),
)


def _usage(found: list[Deployment | ReplicaSet | Pod]) -> set[tuple[str, str, int]]:
    usage = usage_of(
        deployments=[one for one in found if isinstance(one, Deployment)],
        replica_sets=[one for one in found if isinstance(one, ReplicaSet)],
        pods=[one for one in found if isinstance(one, Pod)],
    )
    holders = [app_holder("a"), app_holder("b"), app_holder("a", instance="r")]
    return {
        (h.uid, h.instance, n) for h in holders for n in range(5) if usage.uses(domain_claim(n, h), app_exists=True)
    }


@given(st.lists(objects, max_size=8), st.lists(objects, max_size=4))
def test_more_objects_never_mean_less_use(some: list[Deployment | ReplicaSet | Pod], more: list[Pod]) -> None:
    assert _usage(some) <= _usage(some + more)
    assert _usage(some) | _usage(list(more)) == _usage(some + more)


@given(st.lists(objects, max_size=8))
def test_use_does_not_depend_on_the_order_of_objects(found: list[Deployment | ReplicaSet | Pod]) -> None:
    assert _usage(found) == _usage(found[::-1])


names = st.sampled_from([seven.name, domain_claim(8).name, ""])
claiming = st.one_of(
    st.builds(lambda n, of, claim: deployment(n, 7, of=of, claim=claim), numbers, owners, names),
    st.builds(
        lambda n, of, claim: pod(n, 7, of=of, node="edge-1", annotations={"robotics.io/domain-claim": claim}),
        numbers,
        owners,
        names,
    ),
)


@given(st.lists(objects | claiming, max_size=8))
def test_what_a_sweep_keeps_of_its_lists_is_all_that_usage_reads(found: list[Deployment | ReplicaSet | Pod]) -> None:
    def parts(kept: bool) -> dict[str, object]:
        owned, alone = (owner_as_used, pod_as_used) if kept else (lambda whole: whole, lambda whole: whole)
        usage = usage_of(
            deployments=[owned(one) for one in found if isinstance(one, Deployment)],
            replica_sets=[owned(one) for one in found if isinstance(one, ReplicaSet)],
            pods=[alone(one) for one in found if isinstance(one, Pod)],
        )
        return {field.name: getattr(usage, field.name) for field in dataclasses.fields(usage) if field.name != "owners"}

    assert parts(kept=True) == parts(kept=False)


def test_of_an_environment_a_sweep_keeps_what_names_a_domain() -> None:
    secret = EnvVar(name="ROS_DOMAIN_ID", value_from={"secretKeyRef": {"name": "x", "key": "y"}})
    environment = (EnvVar(name="PATH", value="/bin"), secret, EnvVar(name="ROS_DOMAIN_ID", value="7"))
    spec = PodSpec(containers=(Container(env=environment),), init_containers=(Container(env=environment[:1]),))
    whole = Pod(metadata=pod(7).metadata, spec=spec)
    kept = pod_as_used(whole)
    assert kept.metadata == whole.metadata
    assert [len(container.env) for container in (*kept.spec.containers, *kept.spec.init_containers)] == [2, 0]
    assert (named_ids(kept.spec), unclear_domains(kept.spec)) == (frozenset({7}), frozenset({"valueFrom"}))


@pytest.mark.parametrize("written", ["9" * 5000, "0x7", "\u0667", "07", "7\n"])
def test_an_id_that_is_no_plain_number_names_nothing_and_breaks_nothing(written: str) -> None:
    assert not usage_of(deployments=[deployment(written)]).uses(seven, app_exists=True)
