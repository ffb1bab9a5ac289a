"""A pod that vanishes before it ever ran: read once, and told when the kubelet refused it."""

import asyncio
from typing import Any

import pytest
from tests.support.scripted import ScriptedClient

from robotapp_client.transport.errors import NotFound
from robotapp_scheduler.core.api.core_v1 import Metadata, Pod, PodSpec, PodStatus
from robotapp_scheduler.shell.metrics.metrics import Metrics
from robotapp_scheduler.shell.status.kubelet_rejections import KubeletRejections


def pod(
    *, phase: str = "Pending", reason: str = "", uid: str = "u", deleting: str | None = None, node: str = "n"
) -> Pod:
    meta = Metadata(name="drv", namespace="team", uid=uid, deletion_timestamp=deleting)
    status = PodStatus(phase=phase, reason=reason, message="Node didn't have enough resource: cpu" if reason else "")
    return Pod(metadata=meta, spec=PodSpec(scheduler_name="ours", node_name=node), status=status)


class Desk:
    def __init__(self, answer: Any) -> None:
        self.client = ScriptedClient().always("get", answer)
        self.notes: list[str] = []
        self.metrics = Metrics()
        self.refusals = KubeletRejections(self.client, self, self.metrics)

    def pod_event(self, _pod: Pod, *, warning: bool, reason: str, action: str, note: str, by: str = "") -> None:
        self.notes.append(f"{'Warning' if warning else 'Normal'} {reason} {action} {by}{note}")

    async def after(self, last: Pod) -> list[str]:
        self.refusals.look_at(last)
        task = asyncio.create_task(self.refusals.run())
        for _ in range(5):
            await asyncio.sleep(0)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        return self.notes


@pytest.mark.parametrize("reason", ["OutOfcpu", "OutOfmemory", "UnexpectedAdmissionError", "NodeAffinity"])
async def test_a_refusal_is_an_event_and_a_metric(reason: str) -> None:
    desk = Desk(pod(phase="Failed", reason=reason))
    text = f"n refused the pod after it was bound there: {reason}: Node didn't have enough resource: cpu"
    assert await desk.after(pod()) == [f"Warning KubeletRejected Binding {text}"]
    assert desk.metrics.registry.get_sample_value("scheduler_node_rejections_total", {"reason": reason}) == 1


@pytest.mark.parametrize(
    "answer",
    [
        pod(phase="Succeeded"),
        pod(phase="Failed", reason="Evicted"),
        pod(phase="Failed", reason="OutOfcpu", uid="another"),
        NotFound('pods "drv" not found', status=404, reason="NotFound"),
    ],
)
async def test_any_other_end_is_not_told(answer: Any) -> None:
    desk = Desk(answer)
    assert await desk.after(pod()) == []
    assert desk.client.methods() == ["get"]


@pytest.mark.parametrize("last", [pod(phase="Running"), pod(deleting="2026-01-01T00:00:00Z"), pod(node="")])
async def test_pods_that_ran_or_were_deleted_are_not_even_read(last: Pod) -> None:
    desk = Desk(pod(phase="Failed", reason="OutOfcpu"))
    assert await desk.after(last) == []
    assert desk.client.methods() == []
