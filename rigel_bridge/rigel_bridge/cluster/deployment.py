"""Bring a RobotApp into the cluster, and back to an earlier spec, with its history kept."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from rigel_bridge.cluster import apps, history
from rigel_bridge.cluster.differences import changes, diff
from rigel_bridge.cluster.kubectl import ClusterError, Kubectl, Refusal
from rigel_bridge.cluster.lent import find_additions
from rigel_bridge.cluster.revisions import provenance, same, target
from rigel_bridge.document.failures import Exit

Json = dict[str, Any]
Tell = Callable[[str], None]
"""Takes one line for the user."""


@dataclass(frozen=True, slots=True)
class Written:
    """A write that the API server took."""

    stored: Json
    outcome: str
    """created, unchanged or changed."""
    changes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Proposal:
    """What a rollback would do: a unified diff of the specs, and what of images, accounts and Secrets it would add."""

    name: str
    number: int
    diff: str
    additions: tuple[str, ...]


Approve = Callable[[Proposal], None]
"""Shows a proposal and returns if it shall be carried out. Raises ClusterError if not."""


def deploy(kubectl: Kubectl, app: Mapping[str, Any], *, tell: Tell) -> Written:
    """Apply a RobotApp. The spec it replaces is stored before, because it may have been edited by hand, and the new one after the write."""
    present = apps.read(kubectl, app["metadata"]["name"])
    if present is not None:
        _record(kubectl, present, tell)
    stored = apps.apply(kubectl, app)
    _record(kubectl, stored, tell)
    return _written(present, stored)


def roll_back(kubectl: Kubectl, name: str, *, number: int | None, approve: Approve, tell: Tell) -> tuple[Written, int]:
    """Give the app an earlier spec, byte for byte, if `approve` lets it; returns also the number of the revision it had.

    A revision is written by whoever may write apps of the namespace, who need not be who brings it back.
    """
    present = apps.existing(kubectl, name)
    history.record(kubectl, present)
    chosen = target(history.read(kubectl, present), present["spec"], number)
    if isinstance(chosen, str):
        raise ClusterError(f"RobotApp {name}: {chosen}", code=Exit.MISSING)
    before, after = f"cluster/{name}", f"revision/{chosen.number}"
    shown = diff(present["spec"], chosen.spec, before=before, after=after)
    approve(Proposal(name, chosen.number, shown, tuple(find_additions(present["spec"], chosen.spec))))
    stored = apps.apply(kubectl, apps.bare(present, chosen.spec, chosen.provenance))
    if not same(stored["spec"], chosen.spec):  # fields that others wrote since: an apply leaves them
        stored = apps.replace_spec(kubectl, stored, chosen.spec)
    _record(kubectl, stored, tell)
    return _written(present, stored), chosen.number


def _written(present: Json | None, stored: Json) -> Written:
    if present is None:
        return Written(stored, "created")
    found = tuple(changes(present["spec"], stored["spec"]))
    if not found and provenance(present) == provenance(stored):
        return Written(stored, "unchanged")
    return Written(stored, "changed", found)


def _record(kubectl: Kubectl, app: Json, tell: Tell) -> None:
    """History is optional: a user who may write the app but no ControllerRevision gets a note, and the app is written."""
    try:
        history.record(kubectl, app)
    except ClusterError as error:
        if error.reason is not Refusal.FORBIDDEN:
            raise
        tell(
            f"no history is kept, so there is no rollback: {error}; role robotapp-editor has the right, for a spec with an account "
            "or a Secret with the right to create pods beside it"
        )
