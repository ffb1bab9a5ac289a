"""The camera is in the container: RobotApps on real nodes whose devices our operator claims, our scheduler allocates and our driver hands over."""

import secrets
import time
from collections.abc import Iterator
from typing import Any

import pytest

from campaigns.nodes.claims import CLAIMS, RESTRICTED, events_of, wait_published
from campaigns.nodes.real_pods import FOREVER, pod, run, shell
from robotapp_api.model.names import API_VERSION, Label
from robotapp_claims.rules.device_attributes import DRIVER
from robotapp_testbed import wait_until
from robotapp_testbed.control_plane import components_as_pods
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.machines.nodes import Device, robot
from robotapp_testbed.real import RealNodes

pytestmark = pytest.mark.live

ARM = "serial-0403-6001-a50285bi"
EYE = "video-046d-082d-5f1a33bf"
DEVICES = [
    Device(ARM, "serial", identity="0403:6001:A50285BI"),
    Device(EYE, "video", identity="046d:082d:5F1A33BF", path="/dev/video0"),
]
FIRST_BYTE_S = 5.0
HANDED_ON_S = 3.0
BARE_STARTS = 4
"""On a busy machine a device may take as long as this many starts of a bare pod in the same minute."""
WAITED_S = 60.0
GIVEN_BACK_S = 120.0
"""30 s of refusals, the kubelet's pauses between them, and the looks at events of pods that wait for long."""
TALK = 'exec 3<>"$ROBOTAPP_DEVICE_ARM" && echo hello >&3 && read line <&3 && echo "$line"'
Json = dict[str, Any]


@pytest.fixture(scope="module")
def cluster(real_machine: type[RealNodes]) -> Iterator[RealNodes]:
    with real_machine(
        [robot("robot-1", devices=DEVICES)],
        delays={},
        images=("tools", *components_as_pods.IMAGES),
        kube_scheduler=True,
        cdi=True,
    ) as cp:
        components_as_pods.run(cp, values={"agent": {"intervalSeconds": 2, "driver": {"enabled": True}}})
        assert wait_published(cp, "robot-1", ARM, EYE)
        yield cp


@pytest.fixture
def namespace(cluster: RealNodes) -> Iterator[str]:
    with created(cluster, f"apps-{secrets.token_hex(3)}") as name:
        cluster.kubectl("label", "namespace", name, "pod-security.kubernetes.io/enforce=restricted")
        yield name
        cluster.kubectl(
            "delete", "robotapps", "--all", "-n", name, "--cascade=foreground", f"--timeout={WAITED_S:.0f}s"
        )


def robotapp(name: str, devices: list[Json], **component: Any) -> Json:
    """An app of one component as `restricted` wants it."""
    driver = {
        "name": "driver",
        "image": "localhost/robotapp-tools:testbed",
        "command": list(FOREVER),
        "devices": devices,
        "securityContext": {"allowPrivilegeEscalation": False, "capabilities": {"drop": ["ALL"]}},
        "template": {"spec": {"securityContext": RESTRICTED, "terminationGracePeriodSeconds": 1}},
        **component,
    }
    spec = {"ros": {"distro": "humble"}, "components": [driver]}
    return {"apiVersion": API_VERSION, "kind": "RobotApp", "metadata": {"name": name}, "spec": spec}


def measure_bare_start_s(cluster: RealNodes, namespace: str) -> float:
    """Returns how long a pod without devices takes until its first program has run: what this machine can do now."""
    begun = time.monotonic()
    container = {"securityContext": {"allowPrivilegeEscalation": False, "capabilities": {"drop": ["ALL"]}}}
    run(cluster, namespace, pod("bare", "robot-1", securityContext=RESTRICTED, container=container))
    shell(cluster, namespace, "bare", "true")
    duration_s = time.monotonic() - begun
    cluster.kubectl("delete", "pod", "bare", "-n", namespace, "--wait=false")
    return duration_s


def apply(cluster: RealNodes, namespace: str, *objects: Json) -> None:
    cluster.kubectl("apply", "-n", namespace, "-f", "-", stdin=list(objects))


def running_pod(cluster: RealNodes, namespace: str, app: str) -> str:
    """Returns the name of the app's pod that runs and is not about to end, "" without one."""
    selector = f"{Label.APP}={app}"
    pods = cluster.api.get(f"/api/v1/namespaces/{namespace}/pods?labelSelector={selector}")["items"]
    names = [
        pod["metadata"]["name"]
        for pod in pods
        if pod["status"]["phase"] == "Running" and "deletionTimestamp" not in pod["metadata"]
    ]
    return names[0] if names else ""


def wait_running(cluster: RealNodes, namespace: str, app: str, *, timeout_s: float = WAITED_S) -> str:
    """Returns the name of the app's running pod. AssertionError with the app's status at the deadline."""
    if not wait_until(lambda: running_pod(cluster, namespace, app), timeout_s=timeout_s, poll_s=0.05):
        raise AssertionError(cluster.kubectl("get", "robotapp", app, "-n", namespace, "-o", "yaml"))
    return running_pod(cluster, namespace, app)


def condition(cluster: RealNodes, namespace: str, app: str, kind: str) -> Json:
    path = f"/apis/{API_VERSION}/namespaces/{namespace}/robotapps/{app}"
    conditions = cluster.api.get(path).get("status", {}).get("conditions", [])
    return next((one for one in conditions if one["type"] == kind), {})


def test_the_apps_program_opens_its_serial_line_and_its_camera_soon_after_apply(
    cluster: RealNodes, namespace: str, record_property: Any
) -> None:
    begun = time.monotonic()
    wishes = [
        {"name": "arm", "type": "serial", "mountAs": "/dev/arm"},
        {"name": "eye", "type": "camera", "mountAs": "/dev/front-camera"},
    ]
    apply(cluster, namespace, robotapp("arm", wishes))
    arm = wait_running(cluster, namespace, "arm")
    assert shell(cluster, namespace, arm, TALK) == "hello\n"
    first_byte_s = time.monotonic() - begun
    record_property("apply to first byte, s", round(first_byte_s, 2))
    assert shell(cluster, namespace, arm, "id -u; echo $ROBOTAPP_DEVICE_ARM $ROBOTAPP_DEVICE_EYE") == (
        "1000\n/dev/arm /dev/front-camera\n"
    )
    assert shell(cluster, namespace, arm, "head -c 4 /dev/front-camera | wc -c") == "4\n"
    assert wait_until(lambda: condition(cluster, namespace, "arm", "Ready").get("status") == "True", timeout_s=WAITED_S)
    allocated = condition(cluster, namespace, "arm", "Allocated")
    assert allocated["status"] == "True", allocated
    assert "not handed over" not in allocated["message"]
    assert first_byte_s <= max(FIRST_BYTE_S, BARE_STARTS * measure_bare_start_s(cluster, namespace))


def test_a_second_app_waits_names_the_holder_and_runs_when_it_is_gone(
    cluster: RealNodes, namespace: str, record_property: Any
) -> None:
    wish = [{"name": "arm", "type": "serial"}]
    apply(cluster, namespace, robotapp("first", wish))
    wait_running(cluster, namespace, "first")
    apply(cluster, namespace, robotapp("second", wish))

    def names_the_holder() -> bool:
        allocated = condition(cluster, namespace, "second", "Allocated")
        return allocated.get("status") == "False" and f"{namespace}/first" in allocated.get("message", "")

    assert wait_until(names_the_holder, timeout_s=WAITED_S), condition(cluster, namespace, "second", "Allocated")
    cluster.kubectl("delete", "robotapp", "first", "-n", namespace, "--cascade=foreground")
    assert wait_until(lambda: not running_pod(cluster, namespace, "first"), timeout_s=WAITED_S)
    begun = time.monotonic()
    successor = wait_running(cluster, namespace, "second")
    handed_on_s = time.monotonic() - begun
    record_property("holder gone to successor runs, s", round(handed_on_s, 2))
    assert shell(cluster, namespace, successor, TALK) == "hello\n"
    assert handed_on_s <= max(HANDED_ON_S, BARE_STARTS * measure_bare_start_s(cluster, namespace))


def test_a_replaced_pod_keeps_the_device_and_the_rival_never_gets_it(cluster: RealNodes, namespace: str) -> None:
    wish = [{"name": "arm", "type": "serial"}]
    apply(cluster, namespace, robotapp("first", wish))
    wait_running(cluster, namespace, "first")
    apply(cluster, namespace, robotapp("rival", wish))
    for _ in range(5):
        before = wait_running(cluster, namespace, "first")
        cluster.kubectl("delete", "pod", before, "-n", namespace, "--wait=true")
        after = wait_running(cluster, namespace, "first")
        assert after != before
        assert shell(cluster, namespace, after, TALK) == "hello\n"
        assert not running_pod(cluster, namespace, "rival")


def test_a_suspended_app_gives_its_device_back(cluster: RealNodes, namespace: str) -> None:
    wish = [{"name": "eye", "type": "camera"}]
    apply(cluster, namespace, robotapp("first", wish))
    wait_running(cluster, namespace, "first")
    apply(cluster, namespace, robotapp("second", wish))
    cluster.kubectl(
        *("patch", "robotapp", "first", "-n", namespace, "--type=merge", "-p", '{"spec": {"suspend": true}}')
    )
    wait_running(cluster, namespace, "second")


def pods_of(cluster: RealNodes, namespace: str, app: str) -> list[Json]:
    items: list[Json] = cluster.api.get(f"/api/v1/namespaces/{namespace}/pods?labelSelector={Label.APP}={app}")["items"]
    return [pod for pod in items if "deletionTimestamp" not in pod["metadata"]]


def claims_of(cluster: RealNodes, namespace: str, app: str) -> list[Json]:
    items: list[Json] = cluster.api.get(f"{CLAIMS.format(namespace)}?labelSelector={Label.APP}={app}")["items"]
    return items


def place_with_arm(cluster: RealNodes, namespace: str, app: str) -> tuple[Json, Json]:
    """Binds the app's pod with its claim for the arm, as a scheduler would that has not seen who has it. Returns both."""

    def may_be_bound() -> bool:
        pods = pods_of(cluster, namespace, app)
        return (
            len(pods) == 1 and not pods[0]["spec"].get("schedulingGates") and bool(claims_of(cluster, namespace, app))
        )

    assert wait_until(may_be_bound, timeout_s=WAITED_S), cluster.kubectl(
        "get", "robotapp,deployment,pod,resourceclaim", "-n", namespace, "-o", "yaml"
    )
    (pod,), (claim,) = pods_of(cluster, namespace, app), claims_of(cluster, namespace, app)
    owner = claim["metadata"]["ownerReferences"][0]
    users = [
        {"resource": "pods", "name": pod["metadata"]["name"], "uid": pod["metadata"]["uid"]},
        {"apiGroup": "robotics.io", "resource": "robotapps", "name": owner["name"], "uid": owner["uid"]},
    ]
    result = {"request": "arm", "driver": DRIVER, "pool": "robot-1", "device": ARM}
    path = f"{CLAIMS.format(namespace)}/{claim['metadata']['name']}/status"
    cluster.api.patch(path, {"status": {"allocation": {"devices": {"results": [result]}}, "reservedFor": users}})
    name = pod["metadata"]["name"]
    target = {"apiVersion": "v1", "kind": "Node", "name": "robot-1"}
    binding = {"apiVersion": "v1", "kind": "Binding", "metadata": {"name": name}, "target": target}
    cluster.api.create(f"/api/v1/namespaces/{namespace}/pods/{name}/binding", binding)
    return pod, claim


def uids(objects: list[Json]) -> set[str]:
    return {item["metadata"]["uid"] for item in objects}


def test_a_pod_that_cannot_have_its_device_for_long_is_replaced_with_its_claim(
    cluster: RealNodes, namespace: str, record_property: Any
) -> None:
    wish = [{"name": "arm", "type": "serial"}]
    apply(cluster, namespace, robotapp("first", wish))
    holder = wait_running(cluster, namespace, "first")
    other = robotapp("second", wish)
    other["spec"]["schedulerName"] = "nobody"
    apply(cluster, namespace, other)

    pod, claim = place_with_arm(cluster, namespace, "second")
    begun = time.monotonic()
    assert wait_until(
        lambda: "is in use by" in events_of(cluster, namespace, pod["metadata"]["name"]), timeout_s=WAITED_S
    )
    assert wait_until(
        lambda: (
            not uids([pod, claim])
            & uids(pods_of(cluster, namespace, "second") + claims_of(cluster, namespace, "second"))
        ),
        timeout_s=GIVEN_BACK_S,
    ), cluster.kubectl("get", "robotapp,resourceclaim,pod,events", "-n", namespace)
    record_property("bound to given back, s", round(time.monotonic() - begun, 1))

    pod, claim = place_with_arm(cluster, namespace, "second")
    cluster.api.delete(f"{CLAIMS.format(namespace)}/{claim['metadata']['name']}")
    begun = time.monotonic()
    assert wait_until(
        lambda: (left := pods_of(cluster, namespace, "second")) and pod["metadata"]["uid"] not in uids(left),
        timeout_s=GIVEN_BACK_S,
    ), cluster.kubectl("get", "robotapp,resourceclaim,pod,events", "-n", namespace)
    record_property("claim deleted by hand to pod replaced, s", round(time.monotonic() - begun, 1))
    assert not claims_of(cluster, namespace, "second")[0].get("status", {}).get("allocation")
    assert shell(cluster, namespace, holder, TALK) == "hello\n"
