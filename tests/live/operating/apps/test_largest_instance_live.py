"""The largest RobotAppInstance there can be is stored as it is, and is as large as we think. Without an operator."""

import json

import pytest
from tests.support.largest import largest_status

from campaigns.rigs.live import INSTANCES
from robotapp_api.model.names import API_VERSION
from robotapp_operator.plan.spec.text import stored_bytes
from robotapp_operator.plan.status.status import MAX_STATUS_BYTES
from robotapp_testbed import ControlPlane


@pytest.mark.parametrize("text", ["a <- b & c", "語", "\x01"], ids=["escaped", "wide", "control"])
def test_the_server_stores_the_largest_status_in_the_room_we_count(
    installed_plane: ControlPlane, namespace: str, text: str
) -> None:
    path = f"{INSTANCES.format(namespace)}/largest"
    status = largest_status(text)
    body = {
        "apiVersion": API_VERSION,
        "kind": "RobotAppInstance",
        "metadata": {"name": "largest", "namespace": namespace},
        "spec": {"app": "largest", "appUID": "0000", "instance": "", "robot": ""},
    }
    for verb in (["create"], ["apply", "--server-side", "--subresource=status", "--field-manager=test"]):
        given = body if verb == ["create"] else body | {"status": status}
        installed_plane.kubectl(*verb, "-f", "-", identity="operator", stdin=given)
    raw = installed_plane.kubectl("get", "--raw", path).strip()
    stored = raw[raw.rindex(',"status":{') + len(',"status":') : -1]
    assert json.loads(stored) == status
    assert len(stored.encode()) <= MAX_STATUS_BYTES
    assert len(stored.encode()) <= stored_bytes(status)
    installed_plane.kubectl("delete", "robotappinstance", "largest", "-n", namespace)
