"""Devices reach containers on real nodes: the chart's driver, the kubelet, containerd 2, kube-scheduler as the scheduler."""

import secrets
from collections.abc import Iterator
from typing import Any

import pytest

from campaigns.nodes import claims, real_pods
from campaigns.nodes.claims import claim, events_of, published, user_of, wait_published
from campaigns.nodes.real_pods import shell
from robotapp_claims.rules.device_attributes import selector_of
from robotapp_claims.rules.node_devices import Device as Kind
from robotapp_testbed import wait_until
from robotapp_testbed.control_plane import components_as_pods
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.machines.nodes import Device, robot
from robotapp_testbed.real import RealNodes

pytestmark = pytest.mark.live

ARM = "serial-0403-6001-a50285bi"
EYE = "video-046d-082d-5f1a33bf"
BUS = "can-can0"
DEVICES = [
    Device(ARM, "serial", identity="0403:6001:A50285BI"),
    Device(EYE, "video", identity="046d:082d:5F1A33BF", path="/dev/video0"),
    Device(BUS, "can", interface="can0"),
]
ROLLED_OUT_S = 60.0
TOLD_S = 40.0
Json = dict[str, Any]
TALK = 'exec 3<>"$ROBOTAPP_DEVICE_ARM" && echo hello >&3 && read line <&3 && echo "$line from $ROBOTAPP_DEVICE_ARM"'
SEE = 'head -c 4 "$ROBOTAPP_DEVICE_EYE" | wc -c'


class Wish(Kind):
    """A wish for a device, as a component writes it."""

    usb_id: str | None = None


SERIAL, CAMERA, CAN = (selector_of(Wish("", kind)) for kind in ("serial", "video", "can"))


@pytest.fixture(scope="module")
def cluster(real_machine: type[RealNodes]) -> Iterator[RealNodes]:
    with real_machine([robot("robot-1", devices=DEVICES)], images=("tools", "agent"), cdi=True) as cp:
        components_as_pods.start_agents(cp, values={"driver": {"enabled": True}})
        assert wait_published(cp, "robot-1", ARM, EYE, BUS)
        yield cp


@pytest.fixture
def namespace(cluster: RealNodes) -> Iterator[str]:
    with created(cluster, f"devices-{secrets.token_hex(3)}") as name:
        cluster.kubectl("label", "namespace", name, "pod-security.kubernetes.io/enforce=restricted")
        yield name


def apply(cluster: RealNodes, namespace: str, *objects: Json) -> None:
    cluster.kubectl("apply", "-n", namespace, "-f", "-", stdin=list(objects))


def wait_told(cluster: RealNodes, namespace: str, pod: str, words: str) -> None:
    """Until an event of the pod has these words."""
    told = wait_until(lambda: words in events_of(cluster, namespace, pod), timeout_s=TOLD_S)
    assert told, f"{words!r} is in no event of {pod}:\n{events_of(cluster, namespace, pod)}"


def kill_driver(cluster: RealNodes) -> None:
    """SIGKILL the driver's first process; returns when its successor runs."""
    (name,) = [pod["metadata"]["name"] for pod in agents(cluster)]
    before = driver_status(cluster)
    cluster.node("robot-1").kill_container(before["containerID"])
    assert wait_until(lambda: driver_status(cluster)["restartCount"] > before["restartCount"], timeout_s=ROLLED_OUT_S)
    cluster.kubectl("wait", "-n", "robotapp-agent", "--for=condition=Ready", "--timeout=60s", "pod", name)


def agents(cluster: RealNodes) -> list[Json]:
    items: list[Json] = cluster.api.get("/api/v1/namespaces/robotapp-agent/pods")["items"]
    return items


def driver_status(cluster: RealNodes) -> Json:
    (pod,) = agents(cluster)
    statuses = pod["status"]["containerStatuses"]
    return next(status for status in statuses if status["name"] == "driver")


def test_programs_without_rights_open_the_devices_of_their_claim(cluster: RealNodes, namespace: str) -> None:
    wanted = claim(
        "arm-and-eye",
        {"arm": SERIAL, "eye": CAMERA},
        [{"requests": ["eye"], "mountAs": "/dev/front-camera"}],
    )
    apply(cluster, namespace, wanted)
    real_pods.run(cluster, namespace, user_of("arm-and-eye", "driver"))
    assert shell(cluster, namespace, "driver", "id -u") == "1000\n"
    assert shell(cluster, namespace, "driver", TALK) == "hello from /dev/ttyUSB0\n"
    assert shell(cluster, namespace, "driver", f"{SEE}; echo $ROBOTAPP_DEVICE_EYE") == "4\n/dev/front-camera\n"


def test_a_second_claim_that_was_given_the_same_device_is_refused_and_told(cluster: RealNodes, namespace: str) -> None:
    """The API server lets two claims have one device; the driver does not."""
    apply(cluster, namespace, claim("first", {"arm": SERIAL}), claim("second", {"arm": SERIAL}))
    real_pods.run(cluster, namespace, user_of("first", "holder"))
    rival = user_of("second", "rival")
    claims.place_past_schedulers(cluster, namespace, rival, request="arm", device=ARM, node="robot-1")
    told = f"device {ARM} of node robot-1 is in use by claim first"
    wait_told(cluster, namespace, "rival", told)
    kill_driver(cluster)
    assert real_pods.get(cluster, namespace, "rival")["status"]["phase"] == "Pending"
    assert shell(cluster, namespace, "holder", TALK) == "hello from /dev/ttyUSB0\n"
    cluster.kubectl("delete", "pod", "-n", namespace, "holder", "--wait=true")
    cluster.kubectl("wait", "-n", namespace, "--for=condition=Ready", "--timeout=60s", "pod", "rival")
    assert shell(cluster, namespace, "rival", TALK) == "hello from /dev/ttyUSB0\n"


def test_a_claim_outlives_its_pods_and_a_killed_driver(cluster: RealNodes, namespace: str) -> None:
    apply(cluster, namespace, claim("arm", {"arm": SERIAL}))
    for turn in range(3):
        real_pods.run(cluster, namespace, user_of("arm", f"driver-{turn}"))
        assert shell(cluster, namespace, f"driver-{turn}", TALK) == "hello from /dev/ttyUSB0\n"
        kill_driver(cluster)
        assert shell(cluster, namespace, f"driver-{turn}", TALK) == "hello from /dev/ttyUSB0\n"
        cluster.kubectl("delete", "pod", "-n", namespace, f"driver-{turn}", "--wait=true")
    assert set(published(cluster, "robot-1")) == {ARM, EYE, BUS}


def test_an_unplugged_device_is_given_to_nobody_until_it_is_back(cluster: RealNodes, namespace: str) -> None:
    node = cluster.node("robot-1")
    node.devices.unplug(EYE)
    try:
        assert wait_until(lambda: "taints" in published(cluster, "robot-1")[EYE], timeout_s=60)
        apply(cluster, namespace, claim("eye", {"eye": CAMERA}), user_of("eye", "watcher"))
        wait_told(cluster, namespace, "watcher", "cannot allocate all claims")
    finally:
        node.devices.plug(EYE)
    cluster.kubectl("wait", "-n", namespace, "--for=condition=Ready", "--timeout=60s", "pod", "watcher")
    assert shell(cluster, namespace, "watcher", SEE) == "4\n"


def test_a_can_bus_is_refused_to_a_pod_with_a_network_of_its_own(cluster: RealNodes, namespace: str) -> None:
    apply(cluster, namespace, claim("bus", {"bus": CAN}), user_of("bus", "driver"))
    wait_told(cluster, namespace, "driver", "hostNetwork: true")


def test_a_can_bus_is_named_to_a_pod_in_the_network_of_the_node(cluster: RealNodes, namespace: str) -> None:
    cluster.kubectl("label", "--overwrite", "namespace", namespace, "pod-security.kubernetes.io/enforce=privileged")
    apply(cluster, namespace, claim("bus", {"bus": CAN}, [{"requests": ["bus"], "network": "Host"}]))
    real_pods.run(cluster, namespace, user_of("bus", "driver", hostNetwork=True))
    assert shell(cluster, namespace, "driver", "echo $ROBOTAPP_DEVICE_BUS") == "can0\n"


def test_the_driver_needs_little_memory(cluster: RealNodes) -> None:
    node = cluster.node("robot-1")
    container_id = driver_status(cluster)["containerID"].rpartition("/")[2]
    (task,) = [line.split() for line in node.ctr("tasks", "list").splitlines() if line.startswith(container_id)]
    status = node.box.run("/bin/cat", f"/proc/{task[1]}/status").splitlines()
    (rss_kib,) = [int(line.split()[1]) for line in status if line.startswith("VmRSS:")]
    assert 10_000 < rss_kib <= 50_000
