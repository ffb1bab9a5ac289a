"""`scripts/bench device_hold`: what it asks for and what it counts as started."""

from campaigns.nodes import device_hold
from robotapp_api.model.app.robotapp import RobotApp


def test_holder_and_rival_want_the_same_device() -> None:
    holder, rival = (RobotApp.model_validate(device_hold.robotapp(name)) for name in ("holder", "rival"))
    assert holder.spec == rival.spec
    assert [device.mount_as for device in holder.spec.components[0].devices] == ["/dev/arm"]


def test_a_pod_whose_container_only_waits_was_not_started() -> None:
    waiting = {"state": {"waiting": {"reason": "ContainerCreating"}}}
    assert not device_hold.started({"status": {}})
    assert not device_hold.started({"status": {"containerStatuses": [waiting]}})
    assert device_hold.started({"status": {"containerStatuses": [waiting | {"containerID": "containerd://1"}]}})
