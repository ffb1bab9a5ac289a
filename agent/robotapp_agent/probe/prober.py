"""Requests that are underway and the replies that belong to them. Pure; times are nanoseconds of the monotonic clock."""

from collections.abc import Sequence
from typing import Final, NamedTuple

from robotapp_agent.probe.keys import KeyRing
from robotapp_agent.probe.packets import REPLY, REQUEST, Packet, node_id, open_packet, seal

MOST_QUEUED_NS: Final = 1_000_000_000
"""A reply that seems to have waited longer than this for us was stamped by a clock that jumped meanwhile."""


class Request(NamedTuple):
    """A datagram to send to the peer."""

    sequence: int
    data: bytes


class _Probe(NamedTuple):
    peer: str
    peer_id: bytes
    sent_ns: int
    round_trip_ns: int | None = None


class Prober:
    """The requests of one round. Each takes one reply, from the node it was sent to, that arrives within `timeout_ns`."""

    def __init__(self, *, own_name: str, keys: KeyRing, session: bytes) -> None:
        self._own_id = node_id(own_name)
        self._keys = keys
        self._session = session
        self._sequence = 0
        self._probes: dict[int, _Probe] = {}

    def __repr__(self) -> str:
        return f"<Prober {self._sequence} requests, {len(self._probes)} in this round>"

    def request(self, peer: str) -> Request | None:
        """The next request to a node, None without a key. It counts from `sent` on."""
        key = self._keys.signing
        if key is None:
            return None
        self._sequence += 1
        packet = Packet(REQUEST, key, self._own_id, node_id(peer), self._session, self._sequence)
        return Request(self._sequence, seal(packet))

    def sent(self, request: Request, *, peer: str, at_ns: int) -> None:
        """Call it right before the datagram goes to the socket: the reply may be here before the call returns."""
        self._probes[request.sequence] = _Probe(peer, node_id(peer), at_ns)

    def not_sent(self, request: Request) -> None:
        """The kernel did not take it (its own queue was full): that is no loss on the way."""
        self._probes.pop(request.sequence, None)

    def receive(self, data: bytes, *, now_ns: int, queued_ns: int, timeout_ns: int) -> bool:
        """Take a reply that waited `queued_ns` for us (0 when unknown). False when it belongs to no open request."""
        reply = open_packet(data, kind=REPLY, receiver=self._own_id, keys=self._keys)
        if reply is None or reply.session != self._session:
            return False
        probe = self._probes.get(reply.sequence)
        if probe is None or probe.round_trip_ns is not None or probe.peer_id != reply.sender:
            return False
        plausible = 0 <= queued_ns <= min(MOST_QUEUED_NS, now_ns - probe.sent_ns)
        round_trip_ns = now_ns - probe.sent_ns - (queued_ns if plausible else 0)
        if round_trip_ns > timeout_ns:
            return False
        self._probes[reply.sequence] = probe._replace(round_trip_ns=round_trip_ns)
        return True

    def finish(self) -> dict[str, Sequence[int | None]]:
        """End the round: by peer the round trips in microseconds in the order of the requests, None where no reply came.

        Replies that come later belong to no request.
        """
        found: dict[str, list[int | None]] = {}
        for probe in self._probes.values():
            trip_ns = probe.round_trip_ns
            found.setdefault(probe.peer, []).append(None if trip_ns is None else (trip_ns + 500) // 1000)
        self._probes = {}
        return dict(found)
