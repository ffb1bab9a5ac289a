"""Every state of claims and pods that ever was, replayed in the order of the store's revisions, and what broke a rule in it.

Revisions are the same counter for all kinds, so events of two watches merge into one exact order.
"""

from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from campaigns.rigs.invariants import Object, broken_rules, things_of

_ENDED = {"Succeeded", "Failed"}


@dataclass(frozen=True, slots=True, order=True)
class Event:
    """One change of one object; `revision` is that of the store after it."""

    revision: int
    kind: str
    gone: bool
    obj: Mapping[str, Any] = field(compare=False)

    @property
    def uid(self) -> str:
        return str(self.obj["metadata"]["uid"])


@dataclass(slots=True)
class Verdict:
    """`grants`: claims made. `broken`: revision and rule, in words."""

    grants: int = 0
    broken: list[str] = field(default_factory=list)


class Judge:
    """At every revision no thing has two users, and what runs in our namespaces is backed by its claim.

    strangers: namespaces where everything is forged, so that nothing of it may ever be given a node.
    """

    def __init__(self, *, namespaces: Collection[str], strangers: Collection[str] = ()) -> None:
        self._strangers = strangers
        self._state = _State(namespaces)
        self._seen: set[str] = set()
        self.verdict = Verdict()

    def __repr__(self) -> str:
        return f"<Judge of {self.verdict.grants} grants: {len(self.verdict.broken)} times broken>"

    def hear(self, events: Iterable[Event]) -> None:
        """What happened next; no event of a later call has an earlier revision."""
        for event in sorted(events):
            if event.kind == "RobotClaim" and event.uid not in self._seen:
                self._seen.add(event.uid)
                self.verdict.grants += 1
            self._state.apply(event)
            problems = [*self._state.broken_by(event), *self._bound_stranger(event)]
            self.verdict.broken += [
                f"revision {event.revision}, grant {self.verdict.grants}: {text}" for text in problems
            ]

    def _bound_stranger(self, event: Event) -> list[str]:
        meta = event.obj["metadata"]
        forged = event.kind == "Pod" and meta["namespace"] in self._strangers and event.obj["spec"].get("nodeName")
        return [f"forged pod {meta['name']} was bound"] if forged else []


class _State:
    """Claims and pods as of one revision, by what they are about, so that a change is judged with its neighbours alone."""

    def __init__(self, namespaces: Collection[str]) -> None:
        self._namespaces = namespaces
        self._claims: dict[str, Object] = {}
        self._pods: dict[str, Object] = {}
        self._users: defaultdict[str, set[str]] = defaultdict(set)
        """Names of the pods' things -> uids of the pods."""
        self._held: defaultdict[str, dict[str, Object]] = defaultdict(dict)
        """Names of the claims' things -> the claims by uid."""

    def apply(self, event: Event) -> None:
        if event.kind == "RobotClaim":
            self._apply_claim(event)
        else:
            self._apply_pod(event)

    def _apply_claim(self, event: Event) -> None:
        before = self._claims.pop(event.uid, None)
        for name in _names_of(before) if before is not None else ():
            self._held[name].pop(event.uid, None)
        if event.gone:
            return
        self._claims[event.uid] = event.obj
        for name in _names_of(event.obj):
            self._held[name][event.uid] = event.obj

    def _apply_pod(self, event: Event) -> None:
        for thing in _things(self._pods.pop(event.uid, None)):
            self._users[thing].discard(event.uid)
        if event.gone:
            return
        self._pods[event.uid] = event.obj
        if event.obj["metadata"]["namespace"] in self._namespaces:
            for thing in _things(event.obj):
                self._users[thing].add(event.uid)

    def broken_by(self, event: Event) -> list[str]:
        """The rules that are broken around the things this event is about."""
        things = _names_of(event.obj) if event.kind == "RobotClaim" else set(_things(event.obj))
        pods = {uid: self._pods[uid] for thing in things for uid in self._users.get(thing, ())}
        if not pods:
            return []
        concerned = {name for pod in pods.values() for name in _things(pod)}
        claims = {uid: claim for name in concerned for uid, claim in self._held.get(name, {}).items()}
        return broken_rules(claims.values(), pods.values())


def _things(pod: Object | None) -> list[str]:
    if pod is None or pod["status"].get("phase") in _ENDED or not pod["spec"].get("nodeName"):
        return []
    return things_of(pod)


def _names_of(claim: Object) -> set[str]:
    device, domain = claim["spec"].get("device"), claim["spec"].get("domain")
    if device:
        return {f"{device['node']}/{device['id']}"}
    return {claim["metadata"]["name"], str(domain["id"])} if domain else set()
