"""The teleoperation pair of e2e/ros_nodes as a RobotApp on real nodes, and what its operator measured."""

import time
from collections.abc import Mapping, Sequence
from typing import Any

from robotapp_testbed import ControlPlane, images, wait_until
from ros_nodes.trips import TRIP, Row, parse, summarise

IMAGES = ("ros2", "ros1")
TRIO_HZ = 20
DOMAIN_S = 90.0
TRIO_CAMERA = (10, 20_000)
FOREIGN_HEARD = "it heard another app"
RESTARTED = "a container was restarted"


def app(
    name: str,
    *,
    ros: int = 2,
    hz: int = 50,
    camera: tuple[float, int] = (0, 0),
    budget_ms: int = 1000,
    nodes: Mapping[str, str] | None = None,
    ros2: Mapping[str, Any] | None = None,
    spec: Mapping[str, Any] | None = None,
    robot: Mapping[str, Any] | None = None,
    operator: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """`camera` is (images per second, bytes). `nodes` pins components; `robot` and `operator` add to the components."""
    pins = nodes or {}
    common = {"image": images.reference(f"ros{ros}"), "imagePullPolicy": "IfNotPresent"}
    components = [
        {
            "name": part,
            **common,
            "args": ["python3", "-m", f"ros_nodes.{part}_node", *args],
            **extra,
            **_pinned(pins.get(part)),
        }
        for part, args, extra in (
            ("operator", [f"--hz={hz}"], {**(operator or {})}),
            ("robot", [f"--camera-hz={camera[0]}", f"--camera-bytes={camera[1]}"], {**(robot or {})}),
        )
    ]
    latency = {"latency": {"budget": f"{budget_ms}ms"}}
    twist = {"type": "geometry_msgs/msg/TwistStamped", "rateHz": hz, **latency}
    edges = [
        {"topic": "/cmd_vel", "from": "operator", "to": "robot", **twist},
        {"topic": "/robot_state", "from": "robot", "to": "operator", **twist},
    ]
    ros_2 = {
        "ros": {"distro": "lyrical"},  # whose Cyclone DDS is the image's
        "ros2": {"rmw": "rmw_cyclonedds_cpp", **(ros2 or {})},
    }
    ros_1 = {"ros": {"distro": "noetic"}, "ros1": {"image": images.reference("ros1")}}
    body = {**(ros_2 if ros == 2 else ros_1), "components": components, "edges": edges, **(spec or {})}
    return {"apiVersion": "robotics.io/v1alpha1", "kind": "RobotApp", "metadata": {"name": name}, "spec": body}


def trio() -> list[dict[str, Any]]:
    """Three pairs with cameras over four nodes (robot-1, robot-2, edge-1, cloud-1)."""
    sides = [("edge-1", "robot-1"), ("edge-1", "robot-2"), ("cloud-1", "robot-1")]
    return [
        app(f"app-{number}", hz=TRIO_HZ, camera=TRIO_CAMERA, nodes={"operator": operator, "robot": robot})
        for number, (operator, robot) in enumerate(sides)
    ]


def problems_of_trio(cp: ControlPlane, namespace: str, *, seconds: float, deadline_us: int) -> list[str]:
    """What was not stable about the three after they ran for `seconds`, in sentences."""
    problems = []
    for name in (each["metadata"]["name"] for each in trio()):
        told = summarise(rows(cp, namespace, name), deadline_us=deadline_us, settle_us=5_000_000)
        restarts = sum(
            status["restartCount"]
            for pod in pods(cp, namespace, name).values()
            for status in pod["status"]["containerStatuses"]
        )
        wrong = {
            "commands are missing": told.sent < seconds * TRIO_HZ * 0.8,
            FOREIGN_HEARD: told.foreign > 0,
            "more than 5 % of the round trips were late": told.missed_share > 0.05,
            "nothing was answered for longer than 5 s": told.longest_gap_us > 5_000_000,
            "camera images are missing": told.frames < seconds * TRIO_CAMERA[0] * 0.5,
            RESTARTED: restarts > 0,
        }
        problems += [f"{name}: {text}: {told}" for text, is_so in wrong.items() if is_so]
    return problems


def _pinned(node: str | None) -> dict[str, Any]:
    return {"template": {"spec": {"nodeSelector": {"kubernetes.io/hostname": node}}}} if node else {}


def apply(cp: ControlPlane, namespace: str, apps: Sequence[Mapping[str, Any]]) -> None:
    cp.kubectl("apply", "--server-side", "-n", namespace, "-f", "-", stdin=list(apps))


def pods(cp: ControlPlane, namespace: str, name: str) -> dict[str, dict[str, Any]]:
    """Pods of an app by component, the newest of each."""
    found = cp.api.get(f"/api/v1/namespaces/{namespace}/pods?labelSelector=robotics.io/app={name}")["items"]
    ordered = sorted(found, key=lambda pod: str(pod["metadata"]["creationTimestamp"]))
    return {
        pod["metadata"]["labels"]["robotics.io/component"]: pod
        for pod in ordered
        if "robotics.io/component" in pod["metadata"]["labels"]
    }


def domain(cp: ControlPlane, namespace: str, name: str) -> int:
    """Of the app's only instance. Its object is written after the app's own status, so it is waited for."""
    path = f"/apis/robotics.io/v1alpha1/namespaces/{namespace}/robotappinstances?labelSelector=robotics.io/app={name}"

    def known() -> list[int]:
        return [item["status"]["domain"] for item in cp.api.get(path)["items"] if "domain" in item.get("status", {})]

    if not wait_until(lambda: bool(known()), timeout_s=DOMAIN_S, poll_s=0.2):
        raise AssertionError(f"no RobotAppInstance of {name} has a domain after {DOMAIN_S:g} s")
    return known()[0]


def rows(cp: ControlPlane, namespace: str, name: str) -> list[Row]:
    """What the app's operator has printed so far; nothing while it does not run."""
    pod = pods(cp, namespace, name).get("operator")
    if pod is None:
        return []
    return parse(cp.kubectl("logs", "-n", namespace, pod["metadata"]["name"], check=False).splitlines())


def trips(cp: ControlPlane, namespace: str, name: str) -> list[Row]:
    return [row for row in rows(cp, namespace, name) if row.kind == TRIP]


def silent(cp: ControlPlane, namespace: str, names: Sequence[str], *, within_s: float) -> list[str]:
    """Apps without any round trip yet when all have one or `within_s` has passed."""

    def missing() -> list[str]:
        return [name for name in names if not trips(cp, namespace, name)]

    wait_until(lambda: not missing(), timeout_s=within_s, poll_s=0.5)
    return missing()


def first_trip_s(cp: ControlPlane, namespace: str, wanted: Mapping[str, Any], *, within_s: float = 60) -> float:
    """Apply the app; seconds from before `kubectl apply` until its first measured round trip can be read."""
    began_s = time.monotonic()
    apply(cp, namespace, [wanted])
    name = wanted["metadata"]["name"]
    if not wait_until(lambda: bool(trips(cp, namespace, name)), timeout_s=within_s, poll_s=0.1):
        raise AssertionError(f"no round trip of {name} after {within_s:g} s: {rows(cp, namespace, name)[:5]}")
    return time.monotonic() - began_s
