"""Handle: how the hooks of a plugin between the choice of a node and the bind reach the API server.

`shell/binding` implements it; a hook finds it as `ctx.handle`. None of its calls raises for what the API server or the
network may do: what happened is in the answer.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final, Protocol

import msgspec

from robotapp_api.claims.objects import Claim
from robotapp_scheduler.core.api.core_v1 import Pod


class Readiness(StrEnum):
    """Outcome of a reservation."""

    READY = "Ready"
    BUSY = "Busy"  # a device went to somebody else: another node may have one
    WAIT = "Wait"  # the domain's claim does not stand: the pod stays pending, with the reason
    GONE = "Gone"
    ERROR = "Error"


@dataclass(frozen=True, slots=True)
class Reserved:
    """`annotations` and `resource_version` go into the Binding; `reason` and `message` to the user otherwise.

    sharing: claims of shared devices, held for the moment of the binding (`Claims.bound`).
    """

    readiness: Readiness
    annotations: Mapping[str, str] = field(default_factory=dict)
    resource_version: str = ""
    reason: str = ""
    message: str = ""
    sharing: tuple[Claim, ...] = ()


READY: Final = Reserved(Readiness.READY)


class BindResult(StrEnum):
    """What is known after a bind."""

    BOUND = "Bound"
    GONE = "Gone"  # deleted, re-created or being deleted: nothing to retry
    TAKEN = "Taken"  # another scheduler bound it
    CHANGED = "Changed"  # still pending, but not the version we decided on
    DEPOSED = "Deposed"  # we lead no longer: nothing was sent, and nothing may be said about the pod
    FAILED = "Failed"


class BindOutcome(msgspec.Struct, frozen=True, gc=False):
    """`message` says why it was not bound; `node` is where the pod is when somebody bound it."""

    result: BindResult
    message: str = ""
    node: str = ""


class Pods(Protocol):
    """Binds pods."""

    def send(self, pod: Pod, node: str, told: Callable[[Exception | None], None]) -> None:
        """The first try of `bind` without a task that waits: `told` gets None when the pod is bound.

        An error is the beginning of `bind`, to be given to it as `refused`.
        """

    async def bind(
        self,
        pod: Pod,
        node: str,
        *,
        annotations: Mapping[str, str] | None = None,
        resource_version: str = "",
        refused: Exception | None = None,
    ) -> BindOutcome:
        """Send a Binding with the pod's uid as precondition and find out what became of it.

        `annotations` are merged into the pod in the same write; `resource_version` is a precondition, too (both
        optional). `refused` is what the first try came to where `send` has made it.
        """


@dataclass(frozen=True, slots=True)
class Handle:
    """What a plugin may write to. One per process."""

    pods: Pods
