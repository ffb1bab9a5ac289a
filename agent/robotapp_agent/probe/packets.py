"""The datagrams of a probe and what makes them trustworthy: authentication and replay windows. Pure.

A request and its reply have the same size (78 bytes, big endian):

| bytes | field |
|---|---|
| 1 | version, 1 |
| 1 | kind: 1 request, 2 reply |
| 8 | id of the key |
| 16, 16 | sender, receiver: first half of the SHA-256 of the node's name |
| 4 | session: known to prober and peer only; new with every start of the prober |
| 4 | nonce: of this request; the peer learns it when the request arrives, and cannot reply before |
| 8 | sequence: counts the requests of the session |
| 4 | held: microseconds from the arrival of the request to its reply; 0 in a request |
| 16 | HMAC-SHA256 of everything before it, truncated |

The code covers the direction and both ends, so a reply is no request, and a request of one pair is none of another.
"""

import hashlib
import hmac
import struct
from typing import Final, NamedTuple

from robotapp_agent.probe.keys import Key, KeyRing

VERSION: Final = 1
REQUEST: Final = 1
REPLY: Final = 2
SESSION_BYTES: Final = 4
NONCE_BYTES: Final = 4
_BODY: Final = struct.Struct(">BB8s16s16s8sQI")
KEY_ID_AT: Final = 2
RECEIVER_AT: Final = 26
"""Where these fields begin."""
_MAC_BYTES: Final = 16
SIZE_BYTES: Final = _BODY.size + _MAC_BYTES

MOST_SESSIONS: Final = 4096
WINDOW: Final = 1024
"""Numbers behind the highest that may still come. A prober counts all its peers together: 160 in a round."""
_WINDOW_BITS: Final = (1 << WINDOW) - 1


class Packet(NamedTuple):
    """The fields of a datagram that was authentic."""

    kind: int
    key: Key
    sender: bytes
    receiver: bytes
    session: bytes
    """With the nonce of the request behind it."""
    sequence: int
    held_us: int = 0


def node_id(name: str) -> bytes:
    """What stands for a node in a datagram: names have up to 253 characters, datagrams one size."""
    return hashlib.sha256(name.encode()).digest()[:16]


def seal(packet: Packet) -> bytes:
    """The datagram."""
    key = packet.key
    body = _BODY.pack(
        VERSION, packet.kind, key.id, packet.sender, packet.receiver, packet.session, packet.sequence, packet.held_us
    )
    return body + hmac.digest(key.secret, body, "sha256")[:_MAC_BYTES]


def open_packet(data: bytes, *, kind: int, receiver: bytes, keys: KeyRing) -> Packet | None:
    """The fields, None when anything is wrong. The cheap reasons come first."""
    if len(data) != SIZE_BYTES or data[0] != VERSION or data[1] != kind:
        return None
    _, _, key_id, sender, addressed, session, sequence, held_us = _BODY.unpack_from(data)
    key = keys.find(key_id) if addressed == receiver else None
    if key is None:
        return None
    code = hmac.digest(key.secret, data[: _BODY.size], "sha256")[:_MAC_BYTES]
    if not hmac.compare_digest(code, data[_BODY.size :]):
        return None
    return Packet(kind, key, sender, receiver, session, sequence, held_us)


class ReplayWindows:
    """Which authentic requests came before, per sender and session. The session that was silent for the longest time goes first.

    Numbers below the first of a session count as seen. What was recorded before this process started, or of a session that
    fell out, is therefore accepted once; it is answered with its own size, within the limit of its source, and gives no prober a time.
    """

    def __init__(self) -> None:
        self._sessions: dict[bytes, tuple[int, int]] = {}
        """The highest number, and a bit for each of the WINDOW numbers up to it."""

    def __repr__(self) -> str:
        return f"<ReplayWindows: {len(self._sessions)} sessions>"

    def is_first(self, packet: Packet) -> bool:
        """Note the packet. False when it came before or is too old to know."""
        name = packet.sender + packet.session[:SESSION_BYTES]
        highest, seen = self._sessions.get(name, (packet.sequence - 1, _WINDOW_BITS))
        ahead = packet.sequence - highest
        if ahead > 0:
            seen = (seen << min(ahead, WINDOW)) & _WINDOW_BITS
            highest = packet.sequence
        mark = 1 << (highest - packet.sequence) if highest - packet.sequence < WINDOW else 0
        if not mark or seen & mark:
            return False
        self._sessions.pop(name, None)
        self._sessions[name] = (highest, seen | mark)
        if len(self._sessions) > MOST_SESSIONS:
            del self._sessions[next(iter(self._sessions))]
        return True
