"""What the queue keeps per pod: its attempts, why it waits, and which events may move it."""

from collections.abc import Hashable

import msgspec

from robotapp_scheduler.core.events.cluster_event import Change
from robotapp_scheduler.core.pods.pod_info import PodInfo


class PreEnqueueStatus(msgspec.Struct, frozen=True):
    """Why a pod is gated, and which kinds of change may end that."""

    plugin: str
    reason: str
    events: Change = Change.ALL
    group: str = ""
    """When set, only events about this group count (uid of a RobotApp, or key of a PodGroup or ResourceClaim)."""
    code: str = ""
    """Reason for the pod's condition; empty: no condition is written."""
    whole_group: bool = False
    """While one pod of `group` is gated, all others of the group are."""
    report_after_s: float = 30.0
    """A pod that is gated for longer gets a condition with the reason."""


class Rejection(msgspec.Struct, frozen=True):
    """Outcome of a failed attempt. Without plugins it is an error, which is retried after back-off without an event."""

    plugins: frozenset[str] = frozenset()
    pending: frozenset[str] = frozenset()
    """Those of `plugins` that returned Pending: when their hint moves the pod, it skips its back-off."""
    costly: bool = False
    """The attempt took as long as one may, so the next must wait longer than usual."""


class QueuedPodInfo:
    """A pod in the queue. The queue alone changes it."""

    __slots__ = (
        "attempts", "errors", "first_seen_s", "gate", "group", "info", "rejection", "rejections", "timestamp_s",
    )  # fmt: skip

    def __init__(self, info: PodInfo, now_s: float) -> None:
        self.info = info
        self.group: Hashable | None = None
        self.first_seen_s = now_s
        self.timestamp_s = now_s
        """First arrival, renewed each time the pod comes back from a failed attempt."""
        self.attempts = 0
        self.rejections = 0
        self.errors = 0
        self.rejection: Rejection | None = None
        self.gate: PreEnqueueStatus | None = None

    def __repr__(self) -> str:
        return f"QueuedPodInfo({self.info.key}, attempts={self.attempts}, gate={self.gate and self.gate.plugin})"

    @property
    def rejected_by(self) -> frozenset[str]:
        """The plugins that keep it from being tried or placed; none for an error or before its first attempt."""
        if self.gate is not None:
            return frozenset((self.gate.plugin,))
        return self.rejection.plugins if self.rejection is not None else frozenset()

    @property
    def is_costly(self) -> bool:
        """Did its last attempt take as long as one may?"""
        return self.rejection is not None and self.rejection.costly

    @property
    def failures(self) -> int:
        """What back-off counts: errors in a row while there are any, else rejections."""
        return self.errors or self.rejections
