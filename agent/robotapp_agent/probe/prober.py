"""Requests that are underway and the replies that belong to them. Pure; times are nanoseconds of the monotonic clock."""

import hashlib
import hmac
from collections.abc import Sequence
from typing import Final, NamedTuple

from robotapp_agent.probe.keys import KeyRing
from robotapp_agent.probe.packets import NONCE_BYTES, REPLY, REQUEST, SESSION_BYTES, Packet, node_id, open_packet, seal

MOST_HELD_NS: Final = 1_000_000
"""What the peer needed to wake up and answer is not the network's time, but only the peer knows it: more than this is not subtracted."""


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
    """The requests of one round. Each takes one reply, from the node it was sent to, that arrives within `timeout_ns`.

    All nodes have the same keys, so a key alone proves no sender. Each peer sees a session of its own, which no other can guess
    from the random `secret`: who holds the keys can neither answer for another nor use up that one's numbers. Nor can a peer
    look nearer than it is by a reply that it sends before the request arrives: each request has a nonce.
    """

    def __init__(self, *, own_name: str, keys: KeyRing, secret: bytes) -> None:
        self._own_id = node_id(own_name)
        self._keys = keys
        self._secret = secret
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
        peer_id = node_id(peer)
        packet = Packet(REQUEST, key, self._own_id, peer_id, self._session(peer_id, self._sequence), self._sequence)
        return Request(self._sequence, seal(packet))

    def sent(self, request: Request, *, peer: str, at_ns: int) -> None:
        """It went to the socket right after `at_ns`. One that did not leave for want of a route is as lost as on the way."""
        self._probes[request.sequence] = _Probe(peer, node_id(peer), at_ns)

    def receive(self, data: bytes, *, received_ns: int, timeout_ns: int) -> bool:
        """Take a reply. False when it belongs to no open request or comes too late."""
        reply = open_packet(data, kind=REPLY, receiver=self._own_id, keys=self._keys)
        if reply is None or not hmac.compare_digest(reply.session, self._session(reply.sender, reply.sequence)):
            return False
        probe = self._probes.get(reply.sequence)
        if probe is None or probe.round_trip_ns is not None or probe.peer_id != reply.sender:
            return False
        elapsed_ns = received_ns - probe.sent_ns
        if not 0 <= elapsed_ns <= timeout_ns:
            return False
        held_ns = min(reply.held_us * 1000, MOST_HELD_NS)
        self._probes[reply.sequence] = probe._replace(round_trip_ns=max(elapsed_ns - held_ns, 0))
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

    def _session(self, peer_id: bytes, sequence: int) -> bytes:
        """The session of a peer, and the nonce of one request to it."""
        session = hashlib.blake2b(peer_id, key=self._secret, digest_size=SESSION_BYTES).digest()
        numbered = sequence.to_bytes(8, "big") + peer_id
        return session + hashlib.blake2b(numbered, key=self._secret, digest_size=NONCE_BYTES).digest()
