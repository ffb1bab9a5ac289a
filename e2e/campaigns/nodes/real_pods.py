"""Pods on real nodes, for tests: busybox in the tools image."""

from collections.abc import Sequence
from typing import Any

from campaigns.rigs.live import part
from robotapp_testbed import ControlPlane, images, wait_until

RUNNING_S = 90.0
FOREVER = ("sleep", "100000")


def pod(name: str, node: str, command: Sequence[str] = FOREVER, **spec: Any) -> dict[str, Any]:
    """Placed on `node` past the scheduler, ends at once when it is deleted. `spec` are further fields of the pod's."""
    container = {
        "name": "main",
        "image": images.reference("tools"),
        "imagePullPolicy": "Never",
        "command": list(command),
        "securityContext": {"runAsUser": 0},  # busybox pings with raw sockets only
        **spec.pop("container", {}),
    }
    return {
        "apiVersion": "v1",
        "kind": "Pod",
        "metadata": {"name": name, "labels": {"app": name}},
        "spec": {"nodeName": node, "terminationGracePeriodSeconds": 0, "containers": [container], **spec},
    }


def component(name: str, **fields: Any) -> dict[str, Any]:
    """A component of a RobotApp that runs on real nodes until it is told to end."""
    line = "trap exit TERM; while :; do sleep 1 & wait; done"
    return part(name, args=["-c", line], **fields) | {"image": images.reference("tools")}


def run(cp: ControlPlane, namespace: str, *pods: dict[str, Any]) -> None:
    """Create them and wait until all are Ready."""
    cp.kubectl("apply", "-n", namespace, "-f", "-", stdin=list(pods))
    names = [each["metadata"]["name"] for each in pods]
    cp.kubectl("wait", "-n", namespace, "--for=condition=Ready", f"--timeout={RUNNING_S:g}s", "pod", *names)


def shell(cp: ControlPlane, namespace: str, name: str, line: str, *, check: bool = True) -> str:
    """What a shell line run in the pod says."""
    return cp.kubectl("exec", "-n", namespace, name, "--", "sh", "-c", line, check=check)


def get(cp: ControlPlane, namespace: str, name: str) -> dict[str, Any]:
    found: dict[str, Any] = cp.api.get(f"/api/v1/namespaces/{namespace}/pods/{name}")
    return found


def address(cp: ControlPlane, namespace: str, name: str) -> str:
    return str(get(cp, namespace, name)["status"]["podIP"])


def container(cp: ControlPlane, namespace: str, name: str) -> dict[str, Any]:
    """Status of its only container: containerID, restartCount, state."""
    (status,) = get(cp, namespace, name)["status"]["containerStatuses"]
    return dict(status)


def round_trip_ms(cp: ControlPlane, namespace: str, name: str, target: str, *, count: int = 5) -> float:
    """The median of `count` pings from the pod."""
    text = shell(cp, namespace, name, f"ping -c {count} -i 0.2 -W 3 {target}")
    times = sorted(float(word.removeprefix("time=")) for word in text.split() if word.startswith("time="))
    assert len(times) == count, text
    return times[count // 2]


def service(name: str, *, headless: bool = False, port: int = 8080) -> dict[str, Any]:
    spec: dict[str, Any] = {"selector": {"app": name}, "ports": [{"name": "main", "port": port}]}
    if headless:
        spec["clusterIP"] = "None"
    return {"apiVersion": "v1", "kind": "Service", "metadata": {"name": name}, "spec": spec}


def await_restart(cp: ControlPlane, namespace: str, name: str, *, above: int, timeout_s: float = RUNNING_S) -> bool:
    def restarted() -> bool:
        status = container(cp, namespace, name)
        return status["restartCount"] > above and "running" in status["state"]

    return wait_until(restarted, timeout_s=timeout_s, poll_s=0.1)
