"""Devices reach containers on real nodes: the chart's driver, the kubelet, containerd 2, kube-scheduler as the scheduler."""

import random
import secrets
import time
from collections.abc import Iterator
from typing import Any

import pytest

from campaigns.nodes import claims, real_pods
from campaigns.nodes.claims import claim, events_of, published, user_of, wait_published
from campaigns.nodes.real_pods import shell
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
RESTARTED_S = 330.0
"""The kubelet waits 10, 20, 40 … 300 s before it starts a container again, by how often any test of the module has killed it."""
TOLD_S = 40.0
TURNS_S = 240.0
USERS = 4
KILLS = 12
ROBOT_1 = {"kubernetes.io/hostname": "robot-1"}
Json = dict[str, Any]
TALK = 'exec 3<>"$ROBOTAPP_DEVICE_ARM" && echo hello >&3 && read line <&3 && echo "$line from $ROBOTAPP_DEVICE_ARM"'
ALONE = f"{claims.talk_alone(20)}; echo alone"
SEE = 'head -c 4 "$ROBOTAPP_DEVICE_EYE" | wc -c'


SERIAL, CAMERA, CAN = (claims.selector_for(kind) for kind in ("serial", "video", "can"))


@pytest.fixture(scope="module")
def cluster(real_machine: type[RealNodes]) -> Iterator[RealNodes]:
    nodes = [robot("robot-1", devices=DEVICES), robot("robot-2", devices=DEVICES[:1])]
    with real_machine(nodes, images=("tools", "agent"), cdi=True) as cp:
        # On robot-2 tests run the driver as a process, which starts again at once, however often it is killed.
        only = {"kubernetes.io/hostname": "robot-1"}
        components_as_pods.start_agents(cp, values={"driver": {"enabled": True}, "nodeSelector": only})
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
    assert wait_until(lambda: driver_status(cluster)["restartCount"] > before["restartCount"], timeout_s=RESTARTED_S)
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
    # The driver of robot-2 that another test ended may have its device published for half a minute more.
    real_pods.run(cluster, namespace, user_of("first", "holder", nodeSelector=ROBOT_1))
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
        real_pods.run(cluster, namespace, user_of("arm", f"driver-{turn}", nodeSelector=ROBOT_1))
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


def test_a_node_that_crashed_gives_the_device_back_to_its_pod_and_to_no_rival(
    cluster: RealNodes, namespace: str
) -> None:
    apply(cluster, namespace, claim("first", {"arm": SERIAL}), claim("second", {"arm": SERIAL}))
    real_pods.run(cluster, namespace, user_of("first", "holder", nodeSelector=ROBOT_1))
    rival = user_of("second", "rival")
    claims.place_past_schedulers(cluster, namespace, rival, request="arm", device=ARM, node="robot-1")
    wait_told(cluster, namespace, "rival", "in use by claim first")
    before = real_pods.container(cluster, namespace, "holder")["restartCount"]
    cluster.node("robot-1").restart()
    assert real_pods.await_restart(cluster, namespace, "holder", above=before)
    cluster.kubectl("wait", "-n", namespace, "--for=condition=Ready", "--timeout=90s", "pod", "holder")
    assert shell(cluster, namespace, "holder", TALK) == "hello from /dev/ttyUSB0\n"
    assert real_pods.get(cluster, namespace, "rival")["status"]["phase"] == "Pending"


def test_a_restarted_kubelet_finds_driver_and_device_again(cluster: RealNodes, namespace: str) -> None:
    apply(cluster, namespace, claim("arm", {"arm": SERIAL}))
    real_pods.run(cluster, namespace, user_of("arm", "driver-0", nodeSelector=ROBOT_1))
    cluster.node("robot-1").kubelet.restart()
    assert shell_when_possible(cluster, namespace, "driver-0", TALK) == "hello from /dev/ttyUSB0\n"
    cluster.kubectl("delete", "pod", "-n", namespace, "driver-0", "--wait=true")
    real_pods.run(cluster, namespace, user_of("arm", "driver-1", nodeSelector=ROBOT_1))
    assert shell(cluster, namespace, "driver-1", TALK) == "hello from /dev/ttyUSB0\n"


def test_claims_that_were_all_given_one_device_take_turns_while_the_driver_is_killed(
    cluster: RealNodes, namespace: str
) -> None:
    """Each program would read what another one writes: the serial line sends everything back."""
    driver = claims.driver_on(cluster, "robot-2")
    driver.start()
    try:
        assert wait_published(cluster, "robot-2", ARM)
        names = [f"user-{number}" for number in range(USERS)]
        for name in names:
            apply(cluster, namespace, claim(name, {"arm": SERIAL}))
            body = user_of(name, name, ["sh", "-c", ALONE], restartPolicy="Never")
            claims.place_past_schedulers(cluster, namespace, body, request="arm", device=ARM, node="robot-2")
        for _ in range(KILLS):
            time.sleep(random.uniform(0.1, 2.0))
            driver.kill()
            driver.start()
        ended = wait_until(lambda: phases(cluster, namespace, names) <= {"Succeeded", "Failed"}, timeout_s=TURNS_S)
        logs = [cluster.kubectl("logs", "-n", namespace, name, check=False) for name in names]
        assert ended, [events_of(cluster, namespace, name) for name in names]
        assert logs == ["alone\n"] * USERS
    finally:
        driver.kill()


def phases(cluster: RealNodes, namespace: str, names: list[str]) -> set[str]:
    return {real_pods.get(cluster, namespace, name)["status"]["phase"] for name in names}


def shell_when_possible(cluster: RealNodes, namespace: str, name: str, line: str) -> str:
    """A kubelet that has just started lets nobody in."""
    assert wait_until(lambda: shell(cluster, namespace, name, "echo up", check=False) == "up\n", timeout_s=TOLD_S)
    return shell(cluster, namespace, name, line)


def test_the_driver_needs_little_memory(cluster: RealNodes) -> None:
    node = cluster.node("robot-1")
    container_id = driver_status(cluster)["containerID"].rpartition("/")[2]
    (task,) = [line.split() for line in node.ctr("tasks", "list").splitlines() if line.startswith(container_id)]
    status = node.box.run("/bin/cat", f"/proc/{task[1]}/status").splitlines()
    (rss_kib,) = [int(line.split()[1]) for line in status if line.startswith("VmRSS:")]
    assert 10_000 < rss_kib <= 50_000
