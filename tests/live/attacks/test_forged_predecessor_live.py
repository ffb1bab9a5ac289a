"""A tenant's Deployment whose pods wear the labels of another namespace's app: it holds none of that app's pods back."""

import secrets
from collections.abc import Iterator
from typing import Any

import pytest

from campaigns.rigs.live import eventually
from campaigns.rigs.simulated_site import SimulatedSite, plain_app
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.machines.network import Topology
from robotapp_testbed.machines.topology import edge

pytestmark = pytest.mark.live
MARK = secrets.token_hex(2)
NODE = f"edge-{MARK}"
Json = dict[str, Any]


@pytest.fixture(scope="module")
def world(installed_plane: ControlPlane) -> Iterator[SimulatedSite]:
    with SimulatedSite(installed_plane, Topology([edge(NODE)]), pools={f"pins-{MARK}": "1-9"}) as made:
        yield made


@pytest.fixture
def abroad(installed_plane: ControlPlane, world: SimulatedSite) -> Iterator[str]:
    """The attacker's namespace, whose `admin` he is."""
    assert world
    with created(installed_plane, f"attacker-{secrets.token_hex(3)}") as namespace:
        rights = ("rolebinding", "owner", "--clusterrole=admin", "--user=tenant", "-n", namespace)
        installed_plane.kubectl("create", *rights)
        yield namespace


def running(world: SimulatedSite) -> list[Json]:
    return [pod for pod in world.pods() if pod["spec"].get("nodeName") and not pod["metadata"].get("deletionTimestamp")]


def test_the_next_driver_starts_beside_a_look_alike_that_runs_elsewhere(world: SimulatedSite, abroad: str) -> None:
    name = f"teleop-{secrets.token_hex(2)}"
    world.create(plain_app(name, parts=("driver",), ros2={"pool": f"pins-{MARK}"}))
    world.watch.until_ready(name, within_s=60)
    (victim,) = running(world)
    world.cp.kubectl("-n", abroad, "create", "-f", "-", stdin=look_alike(victim), identity="tenant")
    pods = f"/api/v1/namespaces/{abroad}/pods"
    (forged,) = eventually(lambda: world.cp.api.get(pods)["items"])
    target = {"kind": "Node", "name": NODE}
    meta = {"name": forged["metadata"]["name"], "uid": forged["metadata"]["uid"]}
    binding = {"apiVersion": "v1", "kind": "Binding", "metadata": meta, "target": target}
    world.cp.api.create(f"{pods}/{meta['name']}/binding", binding)
    world.kubectl("delete", "pod", victim["metadata"]["name"])
    eventually(
        lambda: [pod for pod in running(world) if pod["metadata"]["uid"] != victim["metadata"]["uid"]],
        what=lambda: [pod["status"].get("conditions") for pod in world.pods()],
    )
    world.delete(name)


def look_alike(victim: Json) -> Json:
    """The test binds it, as a scheduler that knows nothing of claims would."""
    labels = victim["metadata"]["labels"]
    mine = {key: value for key, value in labels.items() if key.startswith("robotics.io/")} | {"forged": "yes"}
    container = {"name": "main", "image": "x"}
    meta = {"name": "forged", "labels": mine}
    template = {"metadata": {"labels": mine}, "spec": {"schedulerName": "somebody", "containers": [container]}}
    return {
        "apiVersion": "apps/v1",
        "kind": "Deployment",
        "metadata": meta,
        "spec": {"selector": {"matchLabels": {"forged": "yes"}}, "template": template},
    }
