"""Domains are given back in two phases, when nothing uses or wants them any more."""

from datetime import UTC, datetime

import msgspec
import pytest
from tests.support.claims import objects as make
from tests.support.claims.objects import app_holder, deployment_json, pod_json
from tests.unit.claims.protocol.sweep_rig import SweepRig, number

from robotapp_api.model.names import Annotation
from robotapp_claims.protocol.domains import ensure_domain
from robotapp_claims.protocol.sweeper import Sweeper
from robotapp_claims.rules.domain import DomainRequest
from robotapp_client.api.resources import (
    DEPLOYMENTS,
    JOBS,
    NODES,
    PODS,
    REPLICASETS,
)


async def test_an_unused_domain_of_a_deleted_app_rests_and_is_then_freed() -> None:
    rig = SweepRig()
    name = await rig.domain()
    rig.delete_app()
    await rig.sweep()
    assert rig.phase(name) == "Draining"
    await rig.sweep(after_s=59)
    assert rig.phase(name) == "Draining"
    await rig.sweep(after_s=2)
    assert rig.phase(name) == "gone"


async def test_a_restarted_sweeper_begins_the_rest_anew() -> None:
    rig = SweepRig()
    name = await rig.domain()
    rig.delete_app()
    await rig.sweep()
    rig.sweeper = rig.another()
    await rig.sweep(after_s=61)
    assert rig.phase(name) == "Draining"
    await rig.sweep(after_s=61)
    assert rig.phase(name) == "gone"


async def test_the_claim_of_a_live_app_is_kept_before_it_has_deployments_and_while_suspended() -> None:
    rig = SweepRig(suspend=True)
    name = await rig.domain()
    for _ in range(3):
        await rig.sweep(after_s=100)
    assert rig.phase(name) == "Reserved"


def workload(rig: SweepRig, kind: str, claim: str) -> None:
    uid = rig.app.uid
    template = deployment_json(number(claim), uid=uid)
    if kind == "deployment":
        rig.store.put(DEPLOYMENTS, template)
    elif kind == "replica set":
        rig.store.put(REPLICASETS, template | {"status": {"replicas": 1}})
    else:
        pod = pod_json(number(claim), name="p", uid=uid)
        pod["metadata"]["ownerReferences"] = []
        if kind == "terminating pod":
            pod["metadata"]["deletionTimestamp"] = "2026-01-01T00:00:00Z"
            pod["spec"]["nodeName"] = "edge-1"
        rig.store.put(PODS, pod)


@pytest.mark.parametrize("kind", ["deployment", "replica set"])
async def test_what_may_start_pods_keeps_the_id_while_the_app_exists_and_no_longer(kind: str) -> None:
    rig = SweepRig(ros2={"pool": "another"})  # so that the app itself does not want the id
    name = await rig.domain()
    workload(rig, kind, name)
    await rig.sweep()
    assert rig.phase(name) == "Reserved"
    rig.delete_app()
    await rig.sweep()
    assert rig.phase(name) == "Draining"


@pytest.mark.parametrize("kind", ["pending pod", "terminating pod"])
async def test_a_live_pod_keeps_its_id_after_the_app_whoever_owns_it(kind: str) -> None:
    rig = SweepRig()
    name = await rig.domain()
    workload(rig, kind, name)
    rig.delete_app()
    for _ in range(3):
        await rig.sweep(after_s=100)
    assert rig.phase(name) == "Reserved"


async def test_a_draining_claim_that_is_used_again_goes_back_to_reserved() -> None:
    rig = SweepRig()
    name = await rig.domain()
    rig.delete_app()
    await rig.sweep()
    rig.store.put(PODS, pod_json(number(name), name="late", uid=rig.app.uid))
    await rig.sweep(after_s=100)
    assert rig.phase(name) == "Reserved"


async def test_the_claim_an_instance_does_not_want_leaves_and_the_other_stays() -> None:
    rig = SweepRig()
    first = await rig.domain()
    other = await ensure_domain(rig.store.client(), DomainRequest(rig.app, requested_id=number(first) % 3 + 1))
    rig.store.put(DEPLOYMENTS, deployment_json(other.id, uid=rig.app.uid))
    await rig.sweep()
    await rig.sweep(after_s=61)
    assert (rig.phase(first), rig.phase(other.claim)) == ("gone", "Reserved")


@pytest.mark.parametrize(
    "after",
    [
        {"labels": {"fleet": "b", "robotics.io/robot": "amr-1"}},
        {"labels": {"fleet": "a"}},
        {
            "labels": {"fleet": "a", "robotics.io/robot": "amr-1"},
            "annotations": {"robotics.io/allowed-namespaces": "other"},
        },
    ],
    ids=["left the fleet", "is no robot any more", "admits other namespaces only"],
)
async def test_an_instance_whose_robot_was_lost_gives_its_domain_back(after: dict[str, dict[str, str]]) -> None:
    rig = SweepRig(robots={"nodeSelector": {"matchLabels": {"fleet": "a"}}})
    holder = app_holder(rig.app.uid, instance="amr-1")
    rig.store.put(NODES, {"metadata": {"name": "n1", "labels": {"fleet": "a", "robotics.io/robot": "amr-1"}}})
    name = await rig.domain(holder)
    await rig.sweep()
    assert rig.phase(name) == "Reserved"
    rig.store.put(NODES, {"metadata": {"name": "n1"} | after})
    await rig.sweep()
    assert rig.phase(name) == "Draining"


async def test_an_app_for_any_robot_keeps_one_instance() -> None:
    rig = SweepRig(robots={"nodeSelector": {"matchLabels": {"fleet": "a"}}, "assignment": "Any"})
    for robot in ("amr-1", "amr-2"):
        rig.store.put(NODES, {"metadata": {"name": robot, "labels": {"fleet": "a", "robotics.io/robot": robot}}})
    names = [await rig.domain(app_holder(rig.app.uid, instance=robot)) for robot in ("amr-1", "amr-2")]
    rig.store.put(DEPLOYMENTS, deployment_json(number(names[1]), uid=rig.app.uid, instance="amr-2"))
    await rig.sweep()
    assert [rig.phase(name) for name in names] == ["Draining", "Reserved"]


# A sweep of some namespaces


async def test_a_namespaced_sweep_keeps_a_domain_that_an_app_of_another_namespace_shares() -> None:
    rig = SweepRig()
    name = await rig.domain()
    pod = pod_json(number(name), name="sharer", uid="app-2", annotations={"robotics.io/domain-claim": name})
    pod["metadata"]["namespace"] = "other"
    pod["spec"] |= {"nodeName": "edge-1", "schedulerName": "ros-aware-scheduler"}
    rig.store.put(PODS, pod)
    rig.delete_app()
    rig.sweeper = rig.another(namespaces=("team",))
    for _ in range(3):
        await rig.sweep(after_s=100)
    assert rig.phase(name) == "Reserved"
    rig.store.remove(PODS, "sharer", "other")
    await rig.sweep()
    assert rig.phase(name) == "Draining"


async def test_a_namespaced_sweep_that_may_not_look_elsewhere_leaves_domains_to_the_one_that_may() -> None:
    rig = SweepRig()
    name, device = await rig.domain(), await rig.device("gone")
    rig.delete_app()
    narrow = Sweeper(rig.store.client(namespaces=("team",)), clock=lambda: rig.now, namespaces=("team",))
    await narrow.sweep_once()
    assert (rig.phase(name), rig.phase(device)) == ("Reserved", "gone")
    await rig.sweep()
    rig.now += 61
    await narrow.sweep_once()
    assert rig.phase(name) == "Draining"
    await rig.sweep()
    assert rig.phase(name) == "gone"


@pytest.mark.parametrize(
    ("max_restarts", "used", "phase"), [(0, 0, "Draining"), (2, 0, "Reserved"), (2, 1, "Reserved"), (2, 2, "Draining")]
)
async def test_the_domain_of_an_instance_that_starts_again_stays_until_no_restart_is_left(
    max_restarts: int, used: int, phase: str
) -> None:
    rig = SweepRig(components=[{"name": "save", "job": {}}], completion={"maxRestarts": max_restarts})
    claim = await rig.domain()
    job = msgspec.to_builtins(make.job(number(claim), of=make.labels(rig.app.uid), verdict="Failed"))
    job["metadata"]["annotations"] |= {str(key): str(used) for key in (Annotation.ATTEMPT, Annotation.RESTARTS)}
    rig.store.put(JOBS, job)
    await rig.sweep()
    assert rig.phase(claim) == phase


async def test_the_time_of_jobs_is_over_by_the_wall_clock_of_the_sweep() -> None:
    rig = SweepRig(components=[{"name": "save", "job": {}}], completion={"deadline": "90s"})
    claim = await rig.domain()
    rig.store.put(JOBS, msgspec.to_builtins(make.job(8, of=make.labels(rig.app.uid), created="2026-01-01T00:00:00Z")))
    for minute, phase in ((1, "Reserved"), (2, "Draining")):
        moment = datetime(2026, 1, 1, 0, minute, tzinfo=UTC)
        await rig.another(now=lambda moment=moment: moment).sweep_once()
        assert rig.phase(claim) == phase
