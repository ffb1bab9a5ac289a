"""Each of the ten ROS plugins on pods of RobotApps and on bare annotated pods, with the variants of the thesis."""

import secrets
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from tests.live.scheduling.ros.ros_plugin_cases import (
    APP,
    CAN,
    DARK,
    FAR,
    KINDS,
    MID,
    NEAR,
    PLAYED,
    POD,
    WORLD,
    Case,
    MeasuredStage,
    among,
    document,
)

from campaigns.rigs.stage import CLAIMS, IMAGE, ROBOTAPPS, Json, Stage, nodes
from campaigns.rigs.storage_live import claim, claims_path
from robotapp_api.model.names import Annotation
from robotapp_scheduler.plugins.registry import ROS
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.control_plane.product import start_scheduler
from robotapp_testbed.processes.process import Process

pytestmark = pytest.mark.live

ORDERS = {"Priority": "urgent", "Thesis": "realtime"}
"""Order of the queue -> which of two pods is first: one of higher priority, or one of the class realtime."""
QUEUES = {
    (APP, "Priority"): (FAR, "9"),
    (APP, "Thesis"): (DARK, "9"),
    (POD, "Priority"): (NEAR, "4"),
    (POD, "Thesis"): (MID, "8"),
}
"""Where the pods of a queue may go, and how many processors each requests: more than half of what is left there."""
PRIORITY_CLASSES = "/apis/scheduling.k8s.io/v1/priorityclasses"
BY_HAND = {"ROSQueueSort", "ROSReserve", "ROSBind"}
"""Plugins that choose no node: their tests stand below, each for both kinds."""


@pytest.fixture(scope="module")
def namespace(installed_plane: ControlPlane) -> Iterator[str]:
    """One for all cases: a namespace of its own would cost each of them more than the case."""
    with created(installed_plane, f"test-{secrets.token_hex(3)}") as name:
        yield name


@pytest.fixture(scope="module")
def world(
    installed_plane: ControlPlane, namespace: str, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[MeasuredStage]:
    config: Path = tmp_path_factory.mktemp("ros-plugins") / "scheduler.yaml"
    config.write_text(yaml.safe_dump(document()))
    found = MeasuredStage(installed_plane, namespace)
    with nodes(installed_plane, *WORLD):
        found.furnish()
        process = start_scheduler(installed_plane, config, name="scheduler-ros", sweep_seconds=1, log_format="text")
        found.stage.wait_known(*(node.name for node in WORLD if not node.taints))
        yield found
        process.stop()
        found.clear()


def test_every_ros_plugin_is_played_on_apps_and_on_bare_pods() -> None:
    names = {ref.name for ref in ROS} - {"AllowedNamespaces"}  # ours, and tested in a module of its own
    assert len(names) == 10
    played = {(case.plugin, kind) for case, kind in PLAYED} | {(name, kind) for name in BY_HAND for kind in KINDS}
    assert played == {(name, kind) for name in names for kind in KINDS}


@pytest.mark.parametrize(("case", "kind"), PLAYED, ids=[case.name(kind) for case, kind in PLAYED])
def test_a_plugin_decides(world: MeasuredStage, case: Case, kind: str) -> None:
    name = world.start(case, kind)
    if case.refused:
        world.stage.wait_refused(name, reason="Unschedulable", saying=case.refused)
    else:
        assert world.stage.wait_bound(name) == case.node


def test_a_pod_that_waits_for_a_claim_is_tried_when_it_appears(world: MeasuredStage) -> None:
    name = world.annotated("early", {"shared-data": {"pvc": ["late"]}}, **among([DARK]))
    world.stage.wait_refused(name, reason="Unschedulable", saying='persistentvolumeclaim "late" not found')
    world.cp.api.create(claims_path(world.stage.namespace), claim("late", ""))
    assert world.stage.wait_bound(name) == DARK


# --- Queue, claims, Binding ------------------------------------------------------------------------------------------


def start(world: MeasuredStage, kind: str, name: str, *, annotations: Json, fields: Json, **spec: object) -> str:
    if kind == POD:
        return world.annotated(name, annotations, **spec)
    return world.member(name, fields, **spec)


def test_the_queue_is_ordered_by_priority_or_as_in_the_thesis(
    world: MeasuredStage, installed_plane: ControlPlane, tmp_path: Path
) -> None:
    """Of two pods a node takes one. They wait before their schedulers start, which so see them at once."""
    priority_class = f"urgent-{secrets.token_hex(3)}"
    urgent = {"metadata": {"name": priority_class}, "value": 1000, "preemptionPolicy": "Never"}
    installed_plane.api.create(PRIORITY_CLASSES, urgent)
    names: dict[tuple[str, str, str], str] = {}
    schedulers: list[Process] = []
    try:
        for kind, order in QUEUES:
            names[kind, order, "realtime"] = queued(world, kind, order, "realtime")
            names[kind, order, "urgent"] = queued(world, kind, order, "best_effort", priorityClassName=priority_class)
        schedulers += [ordering(installed_plane, tmp_path, order) for order in ORDERS]
        for kind, order in QUEUES:
            first = ORDERS[order]
            (second,) = set(ORDERS.values()) - {first}
            assert world.stage.wait_bound(names[kind, order, first]) == QUEUES[kind, order][0]
            world.stage.wait_refused(names[kind, order, second], reason="Unschedulable", saying="Insufficient cpu")
    finally:
        for process in schedulers:
            process.stop()
        for (kind, _, _), name in names.items():
            remove(world, kind, name)
        installed_plane.api.delete(f"{PRIORITY_CLASSES}/{priority_class}")


def queued(world: MeasuredStage, kind: str, order: str, qos_class: str, **spec: object) -> str:
    node, cpu = QUEUES[kind, order]
    box = {"name": "main", "image": IMAGE, "resources": {"requests": {"cpu": cpu}}}
    return start(
        world, kind, f"{kind}-{order.lower()}-{qos_class.replace('_', '-')}", schedulerName=f"order-{order.lower()}",
        annotations={"policies": {"qos_class": qos_class}}, fields={"qosClass": qos_class}, containers=[box],
        **among([node]), **spec,
    )  # fmt: skip


def ordering(cp: ControlPlane, folder: Path, order: str) -> Process:
    """A scheduler with this order of the queue, and with a name of its own."""
    name = f"order-{order.lower()}"
    profile = {"pluginConfig": [{"name": "ROSQueueSort", "args": {"order": order}}]}
    config = folder / f"{name}.yaml"
    config.write_text(yaml.safe_dump(document({name: profile})))
    return start_scheduler(cp, config, name=name, sweep_seconds=1, log_format="text")


@pytest.mark.parametrize("kind", KINDS)
def test_a_device_is_claimed_for_one_pod_granted_in_its_binding_and_the_next_pod_waits(
    world: MeasuredStage, kind: str
) -> None:
    """ROSReserve claims, ROSBind hands over: the pod has its grant from the moment it is bound."""
    bus = {"type": CAN.type, "interface": CAN.interface}
    wish = {
        "annotations": {"affinity": {"hardware_requirements": [bus]}},
        "fields": {"devices": [{"name": "bus", **bus}]},
    }
    first = start(world, kind, f"{kind}-holder", **wish)
    assert world.stage.wait_bound(first) == FAR
    assert world.stage.pod(first)["metadata"]["annotations"][str(Annotation.GRANTED_DEVICES)] == CAN.id
    (held,) = claims(world.stage, "device")
    assert held["spec"]["holder"]["name"] == (first if kind == POD else f"{kind}-holder")
    second = start(world, kind, f"{kind}-next", **wish)
    world.stage.wait_refused(second, reason="Unschedulable", saying="had no free device for the pod")
    remove(world, kind, first)
    assert world.stage.wait_bound(second) == FAR
    remove(world, kind, second)
    Stage.wait(lambda: not claims(world.stage, "device"), what=lambda: "a device stays claimed")


def test_a_bare_pods_domain_is_claimed_and_granted_in_its_binding(world: MeasuredStage) -> None:
    name = world.annotated("talker", {"dds-domain": "auto"}, **among([NEAR]))
    assert world.stage.wait_bound(name) == NEAR
    (held,) = claims(world.stage, "domain")
    granted = world.stage.pod(name)["metadata"]["annotations"][str(Annotation.GRANTED_DOMAIN)]
    assert granted == str(held["spec"]["domain"]["id"])


def claims(stage: Stage, thing: str) -> list[Json]:
    """RobotClaims for domains or devices whose holder is in the namespace."""
    items: list[Json] = stage.cp.api.get(CLAIMS)["items"]
    return [each for each in items if thing in each["spec"] and each["spec"]["holder"]["namespace"] == stage.namespace]


def remove(world: MeasuredStage, kind: str, name: str) -> None:
    """End a pod, with the app it is of."""
    if kind == APP:
        app = world.stage.pod(name)["metadata"]["labels"]["robotics.io/app"]
        # In this order: the garbage collector deletes what the app owns, perhaps before we do.
        world.cp.api.delete(f"/apis/apps/v1/namespaces/{world.stage.namespace}/deployments/{app}-planner")
        world.cp.api.delete(f"{ROBOTAPPS.format(world.stage.namespace)}/{app}")
        world.stage.wait(lambda: not world.stage.pods(**{"robotics.io/app": app}), what=lambda: f"pods of {app} stay")
    else:
        world.stage.delete_pod(name)
