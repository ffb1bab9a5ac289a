"""What holds for the scheduling queue at any time."""

from robotapp_scheduler.core.queue.scheduling_queue import SchedulingQueue


def check_queue(queue: SchedulingQueue) -> None:
    """Every pod is in exactly one place, and every place knows only such pods."""
    heaps = (queue._active, queue._backoff, queue._error_backoff)
    places = [uid for heap in heaps for uid in heap.ids()]
    places += [*queue._gated, *queue._flying, *queue._waiting]
    assert len(places) == len(set(places)), f"a pod is in two places: {sorted(places)}"
    assert set(places) == set(queue._pods), f"lost or unknown pods: {set(places) ^ set(queue._pods)}"
    grouped = {uid for members in queue._groups.values() for uid in members}
    with_group = {uid for uid, queued in queue._pods.items() if queued.group is not None}
    assert grouped == with_group, "the group index disagrees with the pods"
    for uid in queue._gated:
        assert queue._pods[uid].gate is not None, f"{uid} is gated without a gate"
