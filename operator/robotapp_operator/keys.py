"""Kinds of work in the queue."""

from enum import StrEnum


class Work(StrEnum):
    APP = "app"
    """Group: app uid. Which instances are there? Asks for their children and the status."""
    CHILDREN = "children"
    """Group: app uid, instance. Domain, Deployments, Services of one instance."""
    STATUS = "status"
    """Group: app uid. Debounced: one write covers a burst of changes."""
    GATES = "gates"
    """Group: app uid, instance. Scheduling gates of pods for other schedulers."""
    WAITING = "waiting"
    """Group: pool. Instances that wait for a domain of this pool try again."""
    POOL = "pool"
    """Group: pool. Its status says how full it is."""
    FLEET = "fleet"
    """Group: namespace. The fleet ConfigMap."""
    PROBES = "probes"
    """Which pairs of nodes the agents should measure."""
    RESYNC = "resync"
    """Compare with a full list of RobotApps: kopf does not report what vanished during a gap."""
