"""usb-sensor on real nodes, as its robotapp.yaml says: our driver hands the port to a container without privileges, and again after it was unplugged."""

import logging
import re
import secrets
import time
from collections.abc import Iterator
from typing import Any

import pytest
from tests.live.reference.apps import read_app, read_log
from tests.support.work_unit import slowness

from campaigns.nodes import teleop_app
from campaigns.nodes.claims import wait_published
from campaigns.nodes.real_pods import shell
from robotapp_api.model.names import API_VERSION
from robotapp_testbed import wait_until
from robotapp_testbed.binaries import pins
from robotapp_testbed.control_plane import components_as_pods
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.machines.nodes import Device, edge, robot
from robotapp_testbed.real import RealNodes

pytestmark = [
    pytest.mark.live,
    pytest.mark.skipif(pins.platform_names()["arch"] != "amd64", reason="wheels of rclpy are for amd64 alone"),
]

logger = logging.getLogger(__name__)

APPS = ("usb-sensor-ros1", "usb-sensor-ros2")
SENSOR = Device("serial-0403-6001-a50285bi", "serial", model="thermometer", identity="0403:6001:A50285BI")
ROBOT, EDGE = "amr-07", "edge-1"
STARTED_S = 90.0
NOTICED_S = 20.0
LOST_S = 11.0
"""A loss of less than 10 s restarts nothing."""
BACK_S = 40.0


@pytest.fixture(scope="module")
def cluster(real_machine: type[RealNodes]) -> Iterator[RealNodes]:
    nodes, delays = [robot(ROBOT, devices=[SENSOR]), edge(EDGE)], {(ROBOT, EDGE): 2}
    with real_machine(
        nodes, delays=delays, images=(*APPS, *components_as_pods.IMAGES), kube_scheduler=True, cdi=True
    ) as cp:
        components_as_pods.run(cp, values={"agent": {"intervalSeconds": 2, "driver": {"enabled": True}}})
        assert wait_published(cp, ROBOT, SENSOR.id)
        yield cp


@pytest.fixture
def namespace(cluster: RealNodes) -> Iterator[str]:
    with created(cluster, f"sensor-{secrets.token_hex(3)}") as name:
        cluster.kubectl("label", "namespace", name, "pod-security.kubernetes.io/enforce=restricted")
        yield name


def read_reason(cp: RealNodes, namespace: str, app: str) -> str:
    """Returns the reason of the app's condition Allocated."""
    path = f"/apis/{API_VERSION}/namespaces/{namespace}/robotapps/{app}"
    conditions: list[dict[str, Any]] = cp.api.get(path).get("status", {}).get("conditions", [])
    return next((str(each["reason"]) for each in conditions if each["type"] == "Allocated"), "")


def read_uid(cp: RealNodes, namespace: str, app: str) -> str:
    """Returns the uid of the driver's newest pod, "" without one."""
    pod = teleop_app.pods(cp, namespace, app).get("driver")
    return str(pod["metadata"]["uid"]) if pod else ""


def count_readings(cp: RealNodes, namespace: str, app: str) -> int:
    """Returns how many readings the listener has counted by its latest summary."""
    summaries = re.findall(r"(\d+) readings, the last", read_log(cp, namespace, app, "listener"))
    return int(summaries[-1]) if summaries else 0


@pytest.mark.parametrize("app", APPS)
def test_readings_arrive_from_another_node_and_arrive_again_after_the_sensor_was_unplugged(
    app: str, cluster: RealNodes, namespace: str
) -> None:
    def wait_for(component: str, words: str, *, timeout_s: float) -> None:
        printed = wait_until(
            lambda: words in read_log(cluster, namespace, app, component), timeout_s=timeout_s * slowness(), poll_s=0.2
        )
        status = "" if printed else cluster.kubectl("get", "robotapp,pods", "-n", namespace, "-o", "wide")
        assert printed, (component, words, read_log(cluster, namespace, app, component), status)

    began_s = time.monotonic()
    teleop_app.apply(cluster, namespace, [read_app(app, {"listener": "Edge"})])
    wait_for("driver", "connected to /dev/sensor", timeout_s=STARTED_S)
    wait_for("listener", "readings, the last", timeout_s=STARTED_S)
    logger.info("%s: readings %.1f s after apply", app, time.monotonic() - began_s)
    before = teleop_app.pods(cluster, namespace, app)
    places = {name: pod["spec"]["nodeName"] for name, pod in before.items()}
    assert places == {"driver": ROBOT, "listener": EDGE}
    assert shell(cluster, namespace, before["driver"]["metadata"]["name"], "id -u") == "65532\n"

    devices = cluster.node(ROBOT).devices
    devices.unplug(SENSOR.id)
    try:
        wait_for("driver", "was unplugged after", timeout_s=NOTICED_S)
        wait_for("driver", "no device at /dev/sensor", timeout_s=NOTICED_S)
        wait_for("listener", "no readings for 2 s", timeout_s=NOTICED_S)
        is_lost = wait_until(lambda: read_reason(cluster, namespace, app) == "DeviceLost", timeout_s=NOTICED_S)
        assert is_lost, cluster.kubectl("get", "robotapp", app, "-n", namespace, "-o", "yaml")
        time.sleep(LOST_S)
    finally:
        devices.plug(SENSOR.id)
    began_s = time.monotonic()
    wait_for("listener", "readings are back after", timeout_s=BACK_S)
    logger.info("%s: readings %.1f s after the sensor was back", app, time.monotonic() - began_s)
    # The pod may have found the sensor again by itself; it is replaced all the same, because the file may mean another one.
    uid = before["driver"]["metadata"]["uid"]
    is_replaced = wait_until(lambda: read_uid(cluster, namespace, app) not in ("", uid), timeout_s=BACK_S * slowness())
    assert is_replaced, cluster.kubectl("get", "robotapp,pods", "-n", namespace, "-o", "yaml")
    wait_for("driver", "connected to /dev/sensor", timeout_s=BACK_S)
    logger.info("%s: the new pod has the sensor %.1f s after it was back", app, time.monotonic() - began_s)
    count = count_readings(cluster, namespace, app)
    assert wait_until(lambda: count_readings(cluster, namespace, app) > count, timeout_s=BACK_S * slowness())
    after = teleop_app.pods(cluster, namespace, app)
    assert after["listener"]["metadata"]["uid"] == before["listener"]["metadata"]["uid"]
    restarts = [status["restartCount"] for pod in after.values() for status in pod["status"]["containerStatuses"]]
    assert restarts == [0, 0]
