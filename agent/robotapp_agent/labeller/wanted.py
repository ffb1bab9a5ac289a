"""Which labels a node shall have, and which of them belong to other writers. Pure; seconds are of any monotonic clock."""

from collections.abc import Iterable, Mapping
from typing import Final

KEPT_S: Final = 30.0
"""A plug that is pulled and put back, or a hub that restarts, takes no label away from the pods that wait for it."""
_FIELD: Final = ".metadata.labels."


class Wanted:
    """Labels of one node: those of a new device at once, those of a device that went for `kept_s` more."""

    def __init__(self, *, kept_s: float = KEPT_S) -> None:
        self._kept_s = kept_s
        self._labels: dict[str, str] = {}
        self._gone_s: dict[str, float] = {}

    def __repr__(self) -> str:
        return f"<Wanted: {len(self._labels)} labels, {len(self._gone_s)} of them about to go>"

    def update(self, labels: Mapping[str, str], *, now_s: float) -> None:
        """What the devices that are plugged in give now."""
        for key in self._labels:
            if key not in labels:
                self._gone_s.setdefault(key, now_s)
        for key in labels:
            self._gone_s.pop(key, None)
        self._labels |= labels

    def at(self, now_s: float) -> dict[str, str]:
        """The labels at this moment; call it with times that ascend."""
        for key in [key for key, since_s in self._gone_s.items() if now_s - since_s >= self._kept_s]:
            del self._gone_s[key], self._labels[key]
        return dict(self._labels)

    @property
    def due_s(self) -> float | None:
        """When the next label goes; None while none is about to."""
        return min(self._gone_s.values()) + self._kept_s if self._gone_s else None


def free_of(wanted: Mapping[str, str], *, on_node: Mapping[str, str], taken: Mapping[str, str]) -> dict[str, str]:
    """The wanted labels without those that other writers have set to another value, as long as that value stands."""
    return {
        key: value
        for key, value in wanted.items()
        if key not in taken or on_node.get(key) in (None, value) or on_node[key] != taken[key]
    }


def keys_of_causes(causes: Iterable[tuple[str, str, str]], wanted: Iterable[str]) -> set[str]:
    """The labels that a refused server-side apply names as owned by others."""
    fields = {field for field, _, _ in causes}
    return {key for key in wanted if f"{_FIELD}{key}" in fields}
