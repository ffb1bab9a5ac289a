"""The order of the queue under each configuration, and what a binding carries."""

from tests.support.scheduling import make_info

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


def test_grants_become_annotations_of_the_binding_under_either_name() -> None:
    for plugin in (ROSBind(), DefaultBinder()):
        assert plugin.bind(domain=7, devices=["usb-cam", "can-can0"]) == {
            "granted.robotics.io/devices": "can-can0,usb-cam",
            "granted.robotics.io/dds-domain": "7",
        }
        assert plugin.bind() == {}
