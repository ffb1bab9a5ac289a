"""Apps with allocated ResourceClaims, and their namespaces, end soon after their last pod with operator, scheduler and driver gone."""

import secrets
import time
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import pytest
from tests.live.operating.apps.test_handed_over_devices import DRIVER, LIDAR, claims, running_driver
from tests.support.work_unit import slowness

from campaigns.rigs.live import Tenant, eventually, part
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.control_plane.product import start_scheduler
from robotapp_testbed.failures import ApiStatusError
from robotapp_testbed.processes.process import Process

pytestmark = pytest.mark.live

END_S = 5.0
"""After the last pod, where `slowness` is 1."""
QUICK = {"spec": {"terminationGracePeriodSeconds": 1}}
"""The controller of namespaces looks again after half of the longest grace period of a pod."""


@pytest.fixture(autouse=True)
def _class(installed_plane: ControlPlane) -> Iterator[None]:
    body = {
        "metadata": {"name": DRIVER},
        "spec": {"selectors": [{"cel": {"expression": f'device.driver == "{DRIVER}"'}}]},
    }
    path = "/apis/resource.k8s.io/v1/deviceclasses"
    installed_plane.api.create(path, {"apiVersion": "resource.k8s.io/v1", "kind": "DeviceClass", **body})
    yield
    installed_plane.api.delete(f"{path}/{DRIVER}")


def is_gone(cp: ControlPlane, path: str) -> bool:
    try:
        cp.api.get(path)
    except ApiStatusError as error:
        return error.status == 404
    return False


def has_standing_consumer(claim: dict[str, Any]) -> bool:
    return {user["resource"] for user in claim.get("status", {}).get("reservedFor", ())} == {"pods", "robotapps"}


@pytest.mark.parametrize("end", ["Background", "Foreground", "namespace"])
def test_they_end_within_seconds_of_the_last_pod(
    installed_plane: ControlPlane, operator: Process, ids: str, record_property: Any, end: str
) -> None:
    cp, namespace = installed_plane, f"ends-{secrets.token_hex(3)}"
    with created(cp, namespace):
        tenant = Tenant(cp, namespace)
        scheduler = start_scheduler(cp, name=f"scheduler-{secrets.token_hex(2)}", sweep_seconds=1)
        try:
            with running_driver(cp):
                tenant.apply("base", part("driver", devices=[LIDAR], template=QUICK), ros2={"pool": ids})
                tenant.wait_ready("base")
                eventually(lambda: [claim for claim in claims(tenant) if has_standing_consumer(claim)])
                operator.stop()
                scheduler.stop()
            # The kubelet removes the slices of a driver that is away.
            app = f"/apis/robotics.io/v1alpha1/namespaces/{namespace}/robotapps/base"
            place = f"/api/v1/namespaces/{namespace}"
            if end == "namespace":
                cp.api.delete(place)
            else:
                cp.api.delete(f"{app}?propagationPolicy={end}")
            eventually(lambda: not tenant.listed("pods"))
            begun = time.monotonic()
            if end == "namespace":
                eventually(lambda: is_gone(cp, place))
            else:
                eventually(lambda: is_gone(cp, app) and not claims(tenant) and not tenant.deployments())
            end_s = time.monotonic() - begun
            record_property("last pod gone to the end, s", round(end_s, 2))
            assert end_s <= END_S * slowness()
        finally:
            with suppress(Exception):
                scheduler.stop()
            operator.start().wait_ready()
