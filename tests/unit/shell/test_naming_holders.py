"""DeviceBusy names who has the device, also when the holder's claim was still on its way when the pod was refused."""

from tests.support.scheduler.placing import Rig
from tests.support.scheduling import device_claim

from robotapp_api.model.names import HARDWARE_PREFIX, EventReason
from robotapp_scheduler.core.api.ros import DeviceHolder, DeviceRequest, RosContext
from robotapp_scheduler.core.cycle.diagnosis import DEVICE_PLUGIN
from robotapp_scheduler.core.cycle.schedule_result import ScheduleResult
from robotapp_scheduler.core.framework.interface import Code
from robotapp_scheduler.core.robotics.device_index import DeviceGrant


async def refused_while_another_is_placed() -> Rig:
    """Pod q wants the device that was promised to a pod which is on its way."""
    rig = Rig()
    devices = rig.core.cluster.devices
    devices.set_labels("n0", {f"{HARDWARE_PREFIX}can-can0": "true"})
    devices.assume("uid-p", (DeviceGrant("can0", "n0", devices.of("n0")[0], True),))
    rig.show("q")
    (queued,) = rig.core.queue.pop()
    holder = DeviceHolder(uid="uid-q", namespace="a", pod_uid="uid-q")
    queued.info.ros = RosContext(devices=(DeviceRequest("can0", "can"),), holder=holder)
    decision = ScheduleResult(
        pod=queued.info, code=Code.UNSCHEDULABLE, message="busy", rejected_by=frozenset({DEVICE_PLUGIN}), queued=queued
    )
    rig.loop._binding_cycle.handle_failure(decision, started_s=0.0)
    return rig


def named(rig: Rig) -> list[str]:
    return [text for reason, name, text in rig.said.lines if (reason, name) == (EventReason.DEVICE_BUSY, "q")]


async def test_the_holder_is_named_once_as_soon_as_it_has_its_claim() -> None:
    rig = await refused_while_another_is_placed()
    rig.loop.tick()
    assert named(rig) == []
    rig.core.cluster.apply_claim(device_claim("n0", "can-can0", uid="uid-p", holder_name="driver", pod="uid-p"))
    for _ in range(3):
        rig.loop.tick()
    (text,) = named(rig)
    assert text.startswith("device can-can0 on n0 is held by")


async def test_of_a_pod_that_is_gone_nothing_is_told() -> None:
    rig = await refused_while_another_is_placed()
    rig.core.cluster.apply_claim(device_claim("n0", "can-can0", uid="uid-p", pod="uid-p"))
    del rig.waiting["uid-q"]
    rig.loop.tick()
    assert named(rig) == []
