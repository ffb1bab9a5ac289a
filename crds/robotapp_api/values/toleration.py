"""Taints and tolerations, by the rules of kube-scheduler 1.37."""

from typing import Final, Protocol

HARD_EFFECTS: Final = frozenset({"NoSchedule", "NoExecute"})
"""Effects of taints that keep new pods away."""


class TaintLike(Protocol):
    """What is read of a taint."""

    @property
    def key(self) -> str: ...
    @property
    def value(self) -> str: ...
    @property
    def effect(self) -> str: ...


class TolerationLike(Protocol):
    """What is read of a toleration."""

    @property
    def key(self) -> str: ...
    @property
    def operator(self) -> str: ...
    @property
    def value(self) -> str: ...
    @property
    def effect(self) -> str: ...


def tolerates(toleration: TolerationLike, taint: TaintLike) -> bool:
    """Does this toleration cover this taint?

    An empty effect covers all effects; an empty key with Exists covers all keys; an empty operator means Equal.
    Gt and Lt never match: they sit behind an alpha gate that is off.
    """
    if toleration.effect and toleration.effect != taint.effect:
        return False
    if toleration.key and toleration.key != taint.key:
        return False
    if toleration.operator == "Exists":
        return True
    if toleration.operator in {"", "Equal"}:
        return toleration.value == taint.value
    return False
