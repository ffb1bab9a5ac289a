"""Whose object this is: labels find candidates, owner references prove.

A user who may write a Deployment may write any label on it, also the uid of another tenant's app. What cannot be forged is
an owner that exists: the chain of owners has to lead, inside one namespace, to a RobotApp of the labelled uid,
and the caller reads from the API server whether that RobotApp exists.
"""

from collections.abc import Iterable
from typing import Final, NamedTuple

from robotapp_claims.rules.objects import Meta

HOPS: Final = 3
"""Pod, ReplicaSet, Deployment: whatever is owned in more steps was not made for a RobotApp."""


class AppRef(NamedTuple):
    """A RobotApp as owner references name it; whether it exists is another question."""

    namespace: str
    name: str
    uid: str


class Owners:
    """The Deployments and ReplicaSets of one listing, by uid."""

    def __init__(self, found: Iterable[Meta] = ()) -> None:
        self._known: dict[str, Meta] = {}
        for meta in found:
            self.add(meta)

    def __repr__(self) -> str:
        return f"<Owners: {len(self._known)} objects>"

    def add(self, meta: Meta) -> None:
        self._known[meta.uid] = meta

    def app_of(self, meta: Meta) -> AppRef | None:
        """The RobotApp whose uid the object's label names, if its owners lead there; None for what only its labels claim."""
        current = meta
        for _ in range(HOPS):
            owner = current.controller
            if owner is None:
                return None
            if owner.is_app:
                return AppRef(meta.namespace, owner.name, owner.uid) if owner.uid == meta.app_uid else None
            known = self._known.get(owner.uid)
            if known is None or known.namespace != meta.namespace:
                return None
            current = known
        return None
