"""Kinds of work in the queue, and the groups their keys are in."""

from enum import StrEnum
from typing import Final


class Work(StrEnum):
    APP = "app"
    """Group: app uid. Finds the instances and adds the keys of their children, their objects and the status."""
    ROBOTS = "robots"
    """Group: app uid. Nodes have changed: finds the instances that were added, removed or have another node."""
    CHILDREN = "children"
    """Group: app uid, instance. Domain, Deployments, Services of one instance."""
    INSTANCE = "instance"
    """Group: app uid, instance. Writes the RobotAppInstance when it differs from what is observed."""
    MOVES = "moves"
    """Group: app uid, instance. Evicts pods that are to start elsewhere, or again."""
    STATUS = "status"
    """Group: app uid. Debounced: one write covers a burst of changes."""
    EXPIRY = "expiry"
    """Group: app uid. Deletes an app some time after its end."""
    GATES = "gates"
    """Group: app uid, instance. Scheduling gates of pods for other schedulers."""
    WAITING = "waiting"
    """Group: pool. Instances without a domain try again, if their app takes its domain from this pool or from another app."""
    POOL = "pool"
    """Group: pool. Its status is its occupancy."""
    POD_EVENTS = "pod-events"
    """Group: namespace. Events of pods there that do not get to their containers."""
    FLEET = "fleet"
    """Group: namespace. The fleet ConfigMap."""
    PROBES = "probes"
    """Which pairs of nodes the agents should measure."""
    RESYNC = "resync"
    """Compare with a full list of RobotApps: kopf does not report what vanished during a gap."""


def pool_group(name: str) -> str:
    """Group of a DomainPool's keys; no app's uid looks like it."""
    return f"pool/{name}"


def namespace_group(name: str) -> str:
    """Group of a namespace's keys."""
    return f"ns/{name}"


def name_of(group: str) -> str:
    """The pool or namespace of such a group."""
    return group.partition("/")[2]


BACKGROUND: Final = frozenset({Work.INSTANCE})
"""Work with workers of its own, which slow down while other work waits, so that it never delays Deployments."""


class StartOver(Exception):  # noqa: N818 - a turn of the protocol, not an error
    """Another writer was faster: read everything again."""
