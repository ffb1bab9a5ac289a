"""RobotAppInstances on a live API server: what people see, that they come back, that they go, and how often they are written."""

import dataclasses
import secrets
import statistics
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from typing import Any

import pytest

from campaigns.rigs import quiet
from campaigns.rigs.live import INSTANCES, Tenant, eventually, part
from robotapp_api.model.names import API_VERSION
from robotapp_operator.plan.render.instance_object import object_name
from robotapp_testbed import ControlPlane
from robotapp_testbed.machines import topology

pytestmark = pytest.mark.usefixtures("operator")
FLEET = 12


@pytest.fixture(scope="module")
def fleet(installed_plane: ControlPlane) -> Iterator[str]:
    """A dozen robots of one kind; gives the label value that chooses them."""
    kind = f"kind-{secrets.token_hex(2)}"
    names = [f"{kind}-{number:02}" for number in range(FLEET)]
    plain = topology.fleet(robots=names, edges=0, clouds=0)
    robots = topology.Topology(dataclasses.replace(node, labels={"example.com/kind": kind}) for node in plain)
    topology.apply(installed_plane, robots)
    yield kind
    topology.remove(installed_plane, robots)


def choosing(kind: str) -> dict[str, Any]:
    return {"nodeSelector": {"matchLabels": {"example.com/kind": kind}}}


def only(tenant: Tenant, name: str) -> dict[str, Any]:
    """The only instance of an app, once there is one."""
    found = eventually(lambda: tenant.instances(name), what=f"no RobotAppInstance of {name}")
    assert len(found) == 1
    return found[0]


def state(item: Mapping[str, Any], kind: str) -> tuple[str, str]:
    conditions = item["status"]["conditions"]
    return next((each["status"], each["reason"]) for each in conditions if each["type"] == kind)


def until_ready(tenant: Tenant, name: str) -> list[dict[str, Any]]:
    """The instances of an app that is Ready, once they all say so too."""
    tenant.wait_ready(name)

    def all_ready() -> list[dict[str, Any]]:
        found = tenant.instances(name)
        return found if found and all(state(item, "Ready")[0] == "True" for item in found) else []

    return eventually(all_ready, what=lambda: tenant.instances(name))


def written(
    cp: ControlPlane, tenant: Tenant, since: datetime, resource: str = "robotappinstances"
) -> Counter[tuple[str, str]]:
    """Writes by name and kind of write (`create`, `patch status`, `delete`)."""
    refs = [
        (record["objectRef"], record["verb"])
        for record in quiet.writes_since(cp, since, namespace=tenant.namespace)
        if record["objectRef"]["resource"] == resource
    ]
    return Counter((ref.get("name", ""), f"{verb} {ref.get('subresource', '')}".strip()) for ref, verb in refs)


def test_kubectl_shows_every_instance_and_a_robot_that_leaves_takes_its_own_along_until_it_comes_back(
    installed_plane: ControlPlane, tenant: Tenant, ids: str, fleet: str
) -> None:
    edge = {"topic": "/odom", "from": "driver", "to": "@robot", "latency": {"budget": "30ms"}}
    driver, grace = part("driver", runsOn=["Robot"]), {"grace": "1s"}
    tenant.apply("fleet", driver, robots=choosing(fleet), connectivity=grace, edges=[edge], ros2={"pool": ids})
    items = until_ready(tenant, "fleet")
    assert [item["spec"]["robot"] for item in items] == [f"{fleet}-{number:02}" for number in range(FLEET)]
    app = tenant.app("fleet")
    for item in items:
        robot = item["spec"]["robot"]
        assert item["metadata"]["name"] == object_name("fleet", robot)
        assert item["metadata"]["labels"] == {
            "robotics.io/app": "fleet",
            "robotics.io/app-uid": app["metadata"]["uid"],
            "robotics.io/instance": robot,
        }
        (owner,) = item["metadata"]["ownerReferences"]
        assert (owner["uid"], owner["controller"], owner["blockOwnerDeletion"]) == (app["metadata"]["uid"], True, False)
        assert item["status"]["components"] == [{"name": "driver", "node": robot, "ready": True, "restarts": 0}]
        assert item["status"]["edges"][0]["nodes"] == [robot, robot]
        assert len(item["status"]["claims"]) == 1
    counts = {"desired": FLEET, "ready": FLEET, "offline": 0, "completed": 0, "failed": 0}
    assert app["status"]["instanceCounts"] == counts
    assert app["status"]["summary"]["robots"] == f"{FLEET}/{FLEET}"
    assert not app["status"].get("troubled")
    lines = installed_plane.kubectl("get", "rai", "-n", tenant.namespace).splitlines()
    assert lines[0].split() == ["NAME", "APP", "ROBOT", "READY", "PHASE", "DOMAIN", "BUDGET", "DEVICES", "NODES", "AGE"]
    first = lines[1].split()
    assert first[1:5] == ["fleet", f"{fleet}-00", "1/1", "Running"]
    assert int(first[5]) == items[0]["status"]["domain"]
    assert first[6] == "0.05/30ms"
    one = installed_plane.kubectl(
        "get", "rai", "-n", tenant.namespace, "--field-selector", f"spec.robot={fleet}-03", "-o", "name"
    )
    assert one.split("/")[1].strip() == object_name("fleet", f"{fleet}-03")
    leaver = f"{fleet}-05"

    def robots() -> set[str]:
        return {item["spec"]["robot"] for item in tenant.instances("fleet")}

    installed_plane.kubectl("label", "node", leaver, "example.com/kind-")
    eventually(lambda: leaver not in robots() and len(robots()) == FLEET - 1, what=robots)
    eventually(lambda: tenant.app("fleet")["status"]["instanceCounts"]["desired"] == FLEET - 1)
    installed_plane.kubectl("label", "node", leaver, f"example.com/kind={fleet}")
    eventually(lambda: len(robots()) == FLEET, what=robots)
    assert len(until_ready(tenant, "fleet")) == FLEET


def test_an_object_that_is_deleted_comes_back_as_it_was_and_an_app_that_is_created_anew_has_its_own(
    installed_plane: ControlPlane, tenant: Tenant, ids: str
) -> None:
    first = tenant.apply("solo", part("a"), ros2={"pool": ids})
    (before,) = until_ready(tenant, "solo")
    pods = {pod["metadata"]["uid"] for pod in tenant.listed("pods")}
    installed_plane.api.delete(f"{INSTANCES.format(tenant.namespace)}/{before['metadata']['name']}")
    eventually(
        lambda: tenant.instances("solo") and only(tenant, "solo")["metadata"]["uid"] != before["metadata"]["uid"]
    )
    (after,) = until_ready(tenant, "solo")
    assert after["status"]["summary"] == before["status"]["summary"]
    assert {pod["metadata"]["uid"] for pod in tenant.listed("pods")} == pods, "nothing depends on it"
    tenant.delete("solo")
    second = tenant.apply("solo", part("a"), ros2={"pool": ids})
    assert first["metadata"]["uid"] != second["metadata"]["uid"]
    (new,) = until_ready(tenant, "solo")
    assert new["metadata"]["name"] == before["metadata"]["name"]
    assert new["spec"]["appUID"] == second["metadata"]["uid"]
    tenant.delete("solo")
    eventually(lambda: not tenant.cp.api.get(INSTANCES.format(tenant.namespace))["items"], what="left behind")


def test_a_namespace_can_be_deleted_what_is_left_behind_is_swept_and_a_lost_owner_is_given_back(
    installed_plane: ControlPlane, tenant: Tenant, ids: str
) -> None:
    ending = f"short-{secrets.token_hex(3)}"  # takes the namespace controller five seconds: the rest happens meanwhile
    installed_plane.api.create("/api/v1/namespaces", {"metadata": {"name": ending}})
    short = Tenant(installed_plane, ending)
    short.apply("app", part("a"), ros2={"pool": ids})
    only(short, "app")
    installed_plane.kubectl("delete", "namespace", ending, "--wait=false")
    path = INSTANCES.format(tenant.namespace)
    orphan = {
        "apiVersion": API_VERSION,
        "kind": "RobotAppInstance",
        "metadata": {"name": "nobodys", "namespace": tenant.namespace},
        "spec": {"app": "nobody", "appUID": "0000", "instance": "", "robot": ""},
    }
    installed_plane.kubectl("create", "-f", "-", identity="operator", stdin=orphan)
    tenant.apply("owner", part("a"), ros2={"pool": ids})
    (before,) = until_ready(tenant, "owner")
    installed_plane.api.patch(f"{path}/{before['metadata']['name']}", {"metadata": {"ownerReferences": None}})

    def mended() -> bool:
        found = installed_plane.api.get(path)["items"]
        return [item["metadata"].get("ownerReferences", [{}])[0].get("name") for item in found] == ["owner"]

    eventually(mended, what=lambda: installed_plane.api.get(path)["items"])
    assert only(tenant, "owner")["metadata"]["uid"] != before["metadata"]["uid"]
    installed_plane.kubectl("delete", "robotapp", "owner", "-n", tenant.namespace, "--cascade=orphan")
    eventually(lambda: not installed_plane.api.get(path)["items"], what=lambda: installed_plane.api.get(path)["items"])
    installed_plane.kubectl("delete", "deployments,services", "--all", "-n", tenant.namespace)
    eventually(
        lambda: not installed_plane.kubectl("get", "namespace", ending, "--ignore-not-found", "-o", "name"),
        what=lambda: installed_plane.kubectl("get", "namespace", ending, "-o", "yaml"),
    )


def test_an_instance_is_written_a_few_times_until_it_is_ready(
    installed_plane: ControlPlane, tenant: Tenant, ids: str, fleet: str
) -> None:
    """That nothing is written at rest is seen by `journeys/test_many_apps.py`."""
    began = datetime.now(UTC)
    tenant.apply("fleet", part("driver", runsOn=["Robot"]), robots=choosing(fleet), ros2={"pool": ids})
    for number in range(4):
        tenant.apply(f"solo-{number}", part("a"), ros2={"pool": ids})
    names = ["fleet", *(f"solo-{number}" for number in range(4))]
    for name in names:
        until_ready(tenant, name)
    objects = FLEET + 4

    def creates() -> int:
        return sum(count for (_, verb), count in written(installed_plane, tenant, began).items() if verb == "create")

    # The server flushes its log in batches.
    eventually(lambda: creates() >= objects, what=creates)
    assert quiet.until_quiet(installed_plane, quiet_s=1, within_s=60, namespace=tenant.namespace)
    per_object: Counter[str] = Counter()
    for (name, verb), count in written(installed_plane, tenant, began).items():
        # A create names no object in the log's reference; there is one for each.
        per_object[name] += count if verb != "create" else 0
    assert creates() == objects
    statuses = [per_object[item["metadata"]["name"]] for name in names for item in tenant.instances(name)]
    assert statistics.median(statuses) + 1 <= 4, f"{per_object} and a create each"
    assert max(statuses) <= 6, per_object
    took_s = (datetime.now(UTC) - began).total_seconds()
    for (name, _), count in written(installed_plane, tenant, began, "robotapps").items():
        assert count <= 3 + took_s, f"{name} was written {count} times within {took_s:.0f} s"


def test_times_that_swing_by_a_fifth_ten_times_are_written_at_most_once(
    installed_plane: ControlPlane, tenant: Tenant, ids: str, nodes: topology.Topology
) -> None:
    robot = next(node for node in nodes if node.robot)
    edge = {"topic": "/cmd_vel", "from": "operator", "to": "driver", "latency": {"budget": "90ms"}}
    parts = [part("operator", runsOn=["Edge"]), part("driver", runsOn=["Robot"])]
    choice = {"nodeSelector": {"matchLabels": {"robotics.io/robot": robot.robot}}}
    with topology.SimulatedTelemetry(installed_plane, nodes) as telemetry:
        telemetry.set_rtt(robot.name, "edge-1", 40.0)
        tenant.apply("noisy", *parts, robots=choice, edges=[edge], ros2={"pool": ids})
        until_ready(tenant, "noisy")
        eventually(
            lambda: state(only(tenant, "noisy"), "BudgetMet") == ("True", "WithinBudget"),
            what=lambda: tenant.instances("noisy"),
        )
        assert quiet.until_quiet(installed_plane, quiet_s=2, within_s=60, namespace=tenant.namespace)
        began = datetime.now(UTC)
        for number in range(10):
            telemetry.set_rtt(robot.name, "edge-1", 40.0 * (0.8 if number % 2 else 1.2))
            time.sleep(0.5)
        for resource in ("robotappinstances", "robotapps"):
            assert sum(written(installed_plane, tenant, began, resource).values()) <= 1, resource
