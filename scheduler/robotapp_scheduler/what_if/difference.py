"""The answer as a difference, and the part of it that a user may see. Pure functions of values."""

import re
from collections.abc import Collection, Iterable, Mapping
from enum import StrEnum
from typing import Final, NamedTuple

import msgspec

from robotapp_api.model.names import PodReason
from robotapp_api.values.placement.round_trips import is_unreachable

NAMELESS: Final = "names of nodes are left out: you may not get nodes"
_WORD: Final = re.compile(r"[\w.-]*\w")


class Outcome(StrEnum):
    """What would become of a pod."""

    MOVES = "Moves"
    PLACED = "Placed"
    PENDING = "Pending"
    STAYS = "Stays"
    """Its node is lost, and it is not replaced."""
    ENDS = "Ends"
    """Its node is lost and nothing makes it anew, or the app that is tried has no such pod any more."""
    MAY_MOVE = "MayMove"
    """It would be placed elsewhere now, and nothing moves it there."""


class EdgeVerdict(StrEnum):
    """The round trip of an edge against its budget."""

    MET = "Met"
    EXCEEDED = "Exceeded"
    UNKNOWN = "Unknown"


class PodChange(msgspec.Struct, frozen=True, kw_only=True, rename={"from_": "from"}):
    """One pod. `code` is the reason of its condition, where it has one; `reason` is for people and may name nodes."""

    namespace: str
    pod: str
    app: str = ""
    component: str = ""
    instance: str = ""
    outcome: Outcome
    from_: str = ""
    to: str = ""
    code: str = ""
    reason: str = ""


class EdgeKey(NamedTuple):
    """An edge of an instance of an app. `number`: of edges that are alike in all this, which one."""

    namespace: str
    app: str
    instance: str
    what: str
    from_: str
    to: str
    number: int = 0


class EdgeTime(NamedTuple):
    """The round trip of an edge: None = unknown, infinite = no probe is answered. `source`: measured, estimated, unknown."""

    us: float | None
    source: str
    budget_us: int
    percentile: int


class EdgeState(msgspec.Struct, frozen=True, rename="camel"):
    """No time and Exceeded: no probe is answered."""

    rtt_ms: float | None
    source: str
    verdict: EdgeVerdict


class EdgeChange(msgspec.Struct, frozen=True, kw_only=True, rename={"from_": "from", "budget_ms": "budgetMs"}):
    """An edge with another verdict than before; `before` is None for an edge of an app that is not there yet."""

    namespace: str
    app: str
    instance: str
    edge: str
    from_: str
    to: str
    budget_ms: float
    percentile: int
    before: EdgeState | None
    after: EdgeState | None


class Hidden(msgspec.Struct, frozen=True):
    """What the user may not see, counted."""

    pods: int = 0
    edges: int = 0


class Answer(msgspec.Struct, frozen=True, kw_only=True, rename="camel"):
    """What would be different. `edges_unchanged`: looked at, and their verdict is as before. `replayed`: running pods judged anew."""

    pods: tuple[PodChange, ...] = ()
    edges: tuple[EdgeChange, ...] = ()
    edges_unchanged: int = 0
    replayed: int = 0
    hidden: Hidden = Hidden()
    notes: tuple[str, ...] = ()
    decided_ms: float = 0.0


def verdict_of(time: EdgeTime) -> EdgeVerdict:
    """Is the edge within its budget?"""
    if time.us is None:
        return EdgeVerdict.UNKNOWN
    return EdgeVerdict.MET if time.us <= time.budget_us else EdgeVerdict.EXCEEDED


def edge_changes(
    before: Mapping[EdgeKey, EdgeTime], after: Mapping[EdgeKey, EdgeTime]
) -> tuple[tuple[EdgeChange, ...], int]:
    """The edges whose verdict differs, those of new apps included, in the order of `after`; and how many are as before.

    The budget is that of `after`, where the edge is there.
    """
    found, same = [], 0
    for key in [*after, *(key for key in before if key not in after)]:
        old, new = _state(before.get(key)), _state(after.get(key))
        latest = after.get(key) or before[key]
        if old is not None and new is not None and old.verdict == new.verdict:
            same += 1
            continue
        found.append(
            EdgeChange(
                namespace=key.namespace,
                app=key.app,
                instance=key.instance,
                edge=key.what,
                from_=key.from_,
                to=key.to,
                budget_ms=latest.budget_us / 1000,
                percentile=latest.percentile,
                before=old,
                after=new,
            )
        )
    return tuple(found), same


def visible(answer: Answer, *, namespace: str, with_nodes: bool, nodes: Collection[str]) -> Answer:
    """The answer for a user who may see the pods of one namespace ("" = all), with the names of `nodes` or without."""
    pods = [change for change in answer.pods if namespace in ("", change.namespace)]
    edges = [change for change in answer.edges if namespace in ("", change.namespace)]
    hidden = Hidden(len(answer.pods) - len(pods), len(answer.edges) - len(edges))
    notes = answer.notes
    if not with_nodes:
        pods, notes = [_nameless(change, nodes) for change in pods], (*notes, NAMELESS)
    return msgspec.structs.replace(answer, pods=tuple(pods), edges=tuple(edges), hidden=hidden, notes=notes)


def in_order(pods: Iterable[PodChange]) -> tuple[PodChange, ...]:
    """By namespace, app, instance and pod."""
    return tuple(sorted(pods, key=lambda change: (change.namespace, change.app, change.instance, change.pod)))


def _state(time: EdgeTime | None) -> EdgeState | None:
    if time is None:
        return None
    shown = None if time.us is None or is_unreachable(time.us) else time.us / 1000
    return EdgeState(shown, time.source, verdict_of(time))


def _nameless(change: PodChange, nodes: Collection[str]) -> PodChange:
    """The reasons of filters count nodes. What names one all the same, as the best place for a held budget, names none here."""
    reason = change.reason if change.code == PodReason.UNSCHEDULABLE else ""
    reason = _WORD.sub(lambda word: "…" if word[0] in nodes else word[0], reason)
    return msgspec.structs.replace(change, from_="", to="", reason=reason)
