"""The keys that authenticate probes, and which of them signs while they are rotated. Pure.

Every file of a mounted Secret is a key, and the kubelets of two nodes show a change of the Secret at different times, up to minutes
apart. No probe is lost by that:

- A new key verifies at once and signs only when it has been here for SETTLED_S. By then every other node has it as well.
- A removed key goes on verifying for KEPT_S, which is longer than others may go on signing with it. It also goes on signing while
  no other key has settled, so that even a Secret whose only key was exchanged in one step loses nothing.
- An agent that has just started has no settled key and signs with the oldest, which the others have for the longest time.
- A reply is signed with the key of its request.

A key that leaked is out at once when the agents restart after its removal.
"""

import hmac
from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

SETTLED_S: Final = 300.0
"""A kubelet shows a changed Secret within its sync period (1 minute) and the life of its cache (1 minute, or a watch)."""
KEPT_S: Final = 600.0
"""More than SETTLED_S plus the time by which two nodes may differ."""
MOST_KEYS: Final = 8
LEAST_BYTES: Final = 16
MOST_BYTES: Final = 1024
KEY_ID_BYTES: Final = 8
CURRENT: Final = "current"


class Key(NamedTuple):
    """`id` follows from the secret, so that every node finds the same one; it does not give the secret away."""

    id: bytes
    secret: bytes


class _Held(NamedTuple):
    key: Key
    name: str
    since_s: float
    gone_s: float | None = None

    @property
    def age(self) -> tuple[bool, str]:
        """Greater is newer: names compare as text, and `current` is the newest."""
        return self.name == CURRENT, self.name

    def is_settled(self, now_s: float) -> bool:
        return now_s - self.since_s >= SETTLED_S


class KeyRing:
    """Starts empty: nothing is sent or answered until `update` brought a key. Seconds are of any monotonic clock."""

    def __init__(self) -> None:
        self._held: dict[bytes, _Held] = {}
        self._watchers: list[Callable[[], None]] = []
        self.signing: Key | None = None
        """The key for new requests; None without keys."""

    def __repr__(self) -> str:
        return f"<KeyRing: {', '.join(sorted(held.name for held in self._held.values())) or 'empty'}>"

    def update(self, files: Mapping[str, bytes], *, now_s: float) -> tuple[str, ...]:
        """Take over the keys by file name. Returns a sentence for each that was left out. Call it every few seconds."""
        problems = [problem for name, secret in files.items() if (problem := _problem_of(name, secret))]
        good = sorted(
            (_Held(key_of(secret), name, now_s) for name, secret in files.items() if not _problem_of(name, secret)),
            key=lambda held: held.age,
        )
        if len(good) > MOST_KEYS:
            oldest = ", ".join(held.name for held in good[:-MOST_KEYS])
            problems.append(
                f"there are {len(good)} probe keys, at most {MOST_KEYS} are used: remove the oldest ({oldest})"
            )
        before = self._held.keys()
        self._held = _merged(self._held, good[-MOST_KEYS:], now_s)
        self.signing = _signing(self._held, now_s)
        if self._held.keys() != before:
            for changed in tuple(self._watchers):
                changed()
        return tuple(problems)

    @property
    def ids(self) -> tuple[bytes, ...]:
        """The ids of all keys that verify."""
        return tuple(self._held)

    def watch(self, changed: Callable[[], None]) -> Callable[[], None]:
        """From now on `changed` is called after each update that brought other `ids`. Returns what ends that."""
        self._watchers.append(changed)
        return lambda: self._watchers.remove(changed)

    def find(self, key_id: bytes) -> Key | None:
        """The key of a datagram, None when there is none of this id."""
        held = self._held.get(key_id)
        return held and held.key


def key_of(secret: bytes) -> Key:
    """The key that a file's content is."""
    return Key(hmac.digest(secret, b"robotapp probe key id", "sha256")[:KEY_ID_BYTES], secret)


def _problem_of(name: str, secret: bytes) -> str:
    if LEAST_BYTES <= len(secret) <= MOST_BYTES:
        return ""
    return (
        f"probe key {name} has {len(secret)} bytes, allowed are {LEAST_BYTES} to {MOST_BYTES}: "
        "put 32 random bytes into this key of the Secret"
    )


def _merged(old: Mapping[bytes, _Held], present: list[_Held], now_s: float) -> dict[bytes, _Held]:
    merged = {held.key.id: held._replace(since_s=_since_s(old, held)) for held in present}
    for key_id, held in old.items():
        gone_s = now_s if held.gone_s is None else held.gone_s
        if key_id not in merged and now_s - gone_s < KEPT_S and len(merged) < 2 * MOST_KEYS:
            merged[key_id] = held._replace(gone_s=gone_s)
    return merged


def _since_s(old: Mapping[bytes, _Held], held: _Held) -> float:
    known = old.get(held.key.id)
    return held.since_s if known is None else known.since_s


def _signing(held: Mapping[bytes, _Held], now_s: float) -> Key | None:
    present = [each for each in held.values() if each.gone_s is None]
    removed = [each for each in held.values() if each.gone_s is not None]
    for group in (present, removed):
        settled = [each for each in group if each.is_settled(now_s)]
        if settled:
            return max(settled, key=lambda each: each.age).key
    oldest = min(present or removed, key=lambda each: each.age, default=None)
    return oldest and oldest.key
