"""The order of the queue under each configuration, and what a binding carries."""

import pytest
from tests.support.scheduler.placing import Scripted, handle_of
from tests.support.scheduling import make_info

from robotapp_scheduler.core.framework.handle import BindOutcome, BindResult, Readiness, Reserved
from robotapp_scheduler.core.framework.interface import BindContext
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.plugins.ros.bind import DefaultBinder, ROSBind
from robotapp_scheduler.plugins.ros.queue_sort import ROSQueueSort, ROSQueueSortArgs


def queued(priority: int = 0, *qos: str) -> PodInfo:
    info = make_info("p", priority=priority)
    info.qos = (qos[0], qos[1], qos[2]) if qos else None
    return info


def test_priority_class_stands_before_the_tier_and_system_pods_before_everything() -> None:
    sort = ROSQueueSort()
    order = [
        sort.queue_key(queued(2_000_000_000), 9.0),
        sort.queue_key(queued(10), 9.0),
        sort.queue_key(queued(0, "realtime", "", ""), 9.0),
        sort.queue_key(queued(0, "sensor_data", "best_effort", ""), 9.0),
        sort.queue_key(queued(0), 1.0),
        sort.queue_key(queued(0), 2.0),
        sort.queue_key(queued(0, "best_effort", "", ""), 0.0),
    ]
    assert order == sorted(order)


def test_the_thesis_order_puts_the_tier_first_and_best_effort_reliability_last() -> None:
    sort = ROSQueueSort(ROSQueueSortArgs(order="Thesis"))
    order = [
        sort.queue_key(queued(0, "realtime", "", ""), 9.0),
        sort.queue_key(queued(0, "system_default", "reliable", "manual_by_topic"), 9.0),
        sort.queue_key(queued(5), 9.0),
        sort.queue_key(queued(0), 9.0),
        sort.queue_key(queued(9, "realtime", "best_effort", ""), 0.0),
    ]
    assert order == sorted(order)


def test_with_ageing_a_waiting_pod_overtakes_a_higher_tier_of_the_same_priority() -> None:
    sort = ROSQueueSort(ROSQueueSortArgs(aging_seconds=60))
    best_effort, realtime = queued(0, "best_effort", "", ""), queued(0, "realtime", "", "")
    assert sort.queue_key(best_effort, 0.0) > sort.queue_key(realtime, 100.0)
    assert sort.queue_key(best_effort, 0.0) < sort.queue_key(realtime, 181.0)


@pytest.mark.parametrize("plugin", [ROSBind(), DefaultBinder()], ids=lambda plugin: plugin.name)
async def test_the_binding_carries_grants_and_annotations_for_the_version_they_were_made_for(plugin: ROSBind) -> None:
    pods, pod = Scripted(), make_info("p")
    context = BindContext(handle_of(pods))
    context.annotations["lab.example/dock"] = "d1"
    context.reserved = Reserved(
        Readiness.READY, annotations={"granted.robotics.io/devices": "can0"}, resource_version="9"
    )
    assert await plugin.bind(pod, "n1", context) == BindOutcome(BindResult.BOUND, node="n1")
    given = {"lab.example/dock": "d1", "granted.robotics.io/devices": "can0"}
    assert pods.asked == [("p", "n1", given, "9")]


async def test_a_bind_goes_on_after_the_first_try_that_was_sent_without_waiting() -> None:
    pods, pod, told = Scripted(), make_info("p"), []
    context = BindContext(handle_of(pods))
    ROSBind().send(pod, "n1", context, told.append)
    context.refused = ConnectionError("reset")
    await ROSBind().bind(pod, "n1", context)
    assert (told, pods.asked) == ([None], [("p", "n1", {}, "")])
