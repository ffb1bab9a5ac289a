"""RobotAppInstances: what runs of an app, one object per instance. Any of them may be missing: they come and go with robots."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from robotapp_api.model.names import Condition, Label, Phase
from robotapp_cli.failures import CliError, Exit
from robotapp_cli.reading.fields import Json, condition, meta, status
from robotapp_cli.reading.session import Session
from robotapp_client.api.resources import ROBOTAPPINSTANCES

MOST_IN_FULL: Final = 10
"""Instances whose components and edges are shown by default."""
_WELL: Final = frozenset({Phase.RUNNING, Phase.SUSPENDED, Phase.COMPLETED})


@dataclass(frozen=True, slots=True)
class Instance:
    """One instance of an app, as its object says; an empty object for one that has none (any more, or yet)."""

    name: str
    obj: Json

    @property
    def observed(self) -> Json:
        return status(self.obj)

    @property
    def domain(self) -> int | None:
        return self.observed.get("domain")

    @property
    def edges(self) -> list[Json]:
        return list(self.observed.get("edges") or [])

    @property
    def components(self) -> list[Json]:
        return list(self.observed.get("components") or [])

    @property
    def well(self) -> bool:
        return self.observed.get("phase") in _WELL and condition(self.obj, Condition.ACCEPTED).get("status") != "False"

    @property
    def summary(self) -> Json:
        found: Json = self.observed.get("summary") or {}
        return found


async def instances_of(session: Session, app: Json) -> list[Instance]:
    """The app's instances: those in trouble first, in the order of the app's status, then by name."""
    listing = await session.client.list(
        ROBOTAPPINSTANCES, namespace=session.home, label_selector=f"{Label.APP_UID}={meta(app)['uid']}"
    )
    found = [Instance(name_of(item), item) for item in listing.items]
    rank = {each.get("instance", ""): at for at, each in enumerate(status(app).get("troubled") or [])}
    return sorted(found, key=lambda each: (rank.get(each.name, len(rank)), each.well, each.name))


def name_of(obj: Json) -> str:
    """Of the instance: its robot's, "" for an app without robots."""
    return str((obj.get("spec") or {}).get("instance") or "")


def name_instance_kind(app: Json) -> str:
    """Returns what an instance with a name is: the app on a robot, or a run of a sweep."""
    return "run" if app["spec"].get("matrix") else "robot"


def chosen(found: Sequence[Instance], robot: str | None, *, app: str) -> list[Instance]:
    """All of them, or that of one robot. Raises CliError (not found)."""
    if robot is None:
        return list(found)
    names = [each.name for each in found]
    if robot not in names:
        listed = ", ".join(sorted(names)[:MOST_IN_FULL]) or "none"
        more = len(names) - MOST_IN_FULL
        text = f"{app} has no instance on robot {robot}; it has: {listed}" + (f" and {more} more" if more > 0 else "")
        raise CliError(text, code=Exit.NOT_FOUND)
    return [each for each in found if each.name == robot]


def in_full(found: Sequence[Instance], *, everything: bool) -> list[Instance]:
    """Those to show in full: all where they are few or everything was asked for, else those that are not well."""
    if everything or len(found) <= MOST_IN_FULL:
        return list(found)
    return [each for each in found if not each.well][:MOST_IN_FULL]
