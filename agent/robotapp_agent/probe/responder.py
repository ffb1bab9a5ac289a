"""What the agent answers to probes of other nodes. Pure."""

from collections.abc import Callable, Hashable
from typing import Final

from robotapp_agent.probe.keys import KeyRing
from robotapp_agent.probe.packets import REPLY, REQUEST, ReplayWindows, node_id, open_packet, seal
from robotapp_api.values.quantities.buckets import Buckets

REPLIES_PER_S: Final = 100.0
"""To one address, for ever. A node is asked by a few dozen others in a round; all of them may share one address behind a gateway."""
REPLIES_AT_ONCE: Final = 200.0
_MOST_HELD_US: Final = 1_000_000
"""More than a prober believes; the field ends at 4294 s."""


class Responder:
    """Answers authentic requests that are addressed to this node, each once, with as many bytes. Silent on everything else.

    What is not authentic changes nothing, not even the allowance of its address, which is easily forged.
    """

    def __init__(self, *, own_name: str, keys: KeyRing, clock_ns: Callable[[], int]) -> None:
        self._own_id = node_id(own_name)
        self._keys = keys
        self._windows = ReplayWindows()
        self._clock_ns = clock_ns
        self._replies = Buckets(per_s=REPLIES_PER_S, burst=REPLIES_AT_ONCE, clock=lambda: clock_ns() / 1e9)

    def __repr__(self) -> str:
        return f"<Responder {self._windows!r}, {self._replies!r}>"

    def answer(self, data: bytes, *, source: Hashable, received_ns: int) -> bytes | None:
        """The reply to a datagram from the address `source`, None for silence. It is sent at once."""
        request = open_packet(data, kind=REQUEST, receiver=self._own_id, keys=self._keys)
        if request is None or not self._windows.is_first(request) or self._replies.wait_s(source):
            return None
        reply = request._replace(kind=REPLY, sender=request.receiver, receiver=request.sender)
        held_us = (self._clock_ns() - received_ns) // 1000
        return seal(reply._replace(held_us=min(max(held_us, 0), _MOST_HELD_US)))
