"""The ROS side of one pod: what it requires (`RosRequest`), and that resolved against the cluster (`RosContext`)."""

from datetime import datetime
from typing import Final

import msgspec

DEFAULT_QOS_CLASS: Final = "system_default"
TIERS: Final = {"realtime": 3, "sensor_data": 2, "system_default": 1, "best_effort": 0}
"""Queue tier per QoS class. DDS reliability is another thing: best-effort cameras must not starve."""
BALANCE_SHARE: Final = 0.05
"""The part of what round trips count for that is left to them, within their budgets, with `objective: Balance`."""
EXCLUSIVE_TYPES: Final = frozenset({"usb", "can", "serial", "gpio"})
"""Hardware requirement types of bare pods that are held by one pod at a time. GPUs are shared by their device plugin."""


class Hardware(msgspec.Struct, frozen=True, gc=False, omit_defaults=True):
    """A capability of the node, not held: a hardware.robotics.io label, or an extended resource. Also components[].requires."""

    type: str = ""
    model: str = ""
    interface: str = ""


class DeviceRequest(msgspec.Struct, frozen=True, gc=False):
    """One device the pod wants. `usb_id` is vid:pid or vid:pid:serial; not exclusive = it must be there, is not held."""

    name: str
    type: str
    model: str = ""
    interface: str = ""
    usb_id: str = ""
    exclusive: bool = True


class InvalidAnnotation(msgspec.Struct, frozen=True, gc=False):
    """Why an annotation cannot be used: where, what was found, what is allowed."""

    key: str
    field: str
    value: str
    allowed: str

    @property
    def message(self) -> str:
        """One sentence for the pod's PodScheduled condition."""
        where = f"annotation {self.key}" + (f", field {self.field}" if self.field else "")
        return f"{where}: {self.value} is not valid; allowed: {self.allowed}"


class RosRequest(msgspec.Struct, frozen=True, gc=False):
    """The scheduler.robotics.io annotations of one pod, checked. Absent fields are None or empty."""

    latency_budget_us: int | None = None
    deadline_us: int | None = None
    qos_class: str = DEFAULT_QOS_CLASS
    reliability: str = ""
    liveliness: str = ""
    master_node: str = ""
    zones: tuple[str, ...] = ()
    hardware: tuple[Hardware, ...] = ()
    peer_pods: tuple[str, ...] = ()
    volume_claims: tuple[str, ...] = ()
    dds_domain: str = ""
    """"auto", a decimal id, or empty."""


class Endpoint(msgspec.Struct, frozen=True, gc=False):
    """The far end of a connection: nodes of which the nearest counts (a peer on a robot may be on any of its computers)."""

    what: str
    """For people: `/cmd_vel to driver`, `robot amr-07`."""
    nodes: tuple[str, ...]
    budget_us: int | None = None
    percentile: int = 95
    required: bool = True
    """False: only scored (the edge is Preferred, or the peer moves after us)."""
    preferred: bool = False
    """The edge is Preferred; `required` all the same while `placement.fallback` holds it."""


class PeerGroup(msgspec.Struct, frozen=True, gc=False):
    """Nodes one of which the pod must share with a peer; no nodes = the peer is not placed yet."""

    what: str
    nodes: tuple[str, ...]


class SharedVolume(msgspec.Struct, frozen=True, gc=False):
    """A claim of the pod's shared data whose volume one node at a time can use, as it is at this moment."""

    claim: str
    missing: bool = False
    """There is no claim of this name in the pod's namespace."""
    volume: str = ""
    """The PersistentVolume it is bound to; empty = none yet."""
    users: tuple[str, ...] = ()
    """Nodes where pods mount it that are not ending; the pod must be on one of them, if there are any."""
    revision: int = 0
    """Of everything that the cache knows of volumes, so that contexts made before a change of it are not equal."""


class DeviceHolder(msgspec.Struct, frozen=True, gc=False):
    """Whose claim a device request may use. `uid` is the RobotApp's, or the pod's for a bare pod."""

    uid: str
    namespace: str
    instance: str = ""
    component: str = ""
    pod_uid: str = ""


class RosContext(msgspec.Struct, frozen=True, gc=False):
    """A pod's ROS requirements resolved against the cluster at one moment. Equal contexts get equal verdicts."""

    tenant: str = ""
    """The pod's namespace: robots choose which they admit."""
    qos_class: str = DEFAULT_QOS_CLASS
    endpoints: tuple[Endpoint, ...] = ()
    unknown_end: bool = False
    """A latency budget of the pod has no other end on a known node. Components of its own app that are not placed yet are known."""
    flows: tuple[tuple[str, int], ...] = ()
    """(node, bit/s) of connections to placed ends, where any node's access link is known."""
    links: int = 0
    """A hash of what is left on all links, so that no result that is kept outlives a change of it."""
    deadline_us: int | None = None
    zones: tuple[str, ...] = ()
    master_node: str = ""
    hardware: tuple[Hardware, ...] = ()
    devices: tuple[DeviceRequest, ...] = ()
    holder: DeviceHolder | None = None
    tiers: tuple[str, ...] = ()
    """`runsOn` where it is a choice: allowed tiers, best first; empty when there is one tier or none."""
    together: tuple[PeerGroup, ...] = ()
    apart: tuple[str, ...] = ()
    """Nodes of peers the pod must not share (separateFrom)."""
    volumes: tuple[SharedVolume, ...] = ()
    """Claims of its shared data that limit where it may be; those that many nodes can use at a time are left out."""
    balance: bool = False
    """`objective: Balance`: load counts before round trips within their budgets."""
    held_until: datetime | None = None
    """Until when Preferred budgets are required (robotics.fallback); None: they are a cost."""


def tier(qos_class: str, *, reliability: str, liveliness: str) -> int:
    """Queue tier 0 to 3; a manual_by_topic publisher that must be reliable is at least 2."""
    base = TIERS.get(qos_class, TIERS[DEFAULT_QOS_CLASS])
    if liveliness == "manual_by_topic" and reliability == "reliable":
        return max(base, 2)
    return base


def thesis_tier(qos_class: str, *, reliability: str, liveliness: str) -> int:
    """Tier by the thesis' rule, which puts every best-effort pod last whatever its class."""
    if reliability == "best_effort":
        return 0
    if reliability == "reliable" and liveliness == "manual_by_topic":
        return 2
    return TIERS.get(qos_class, TIERS[DEFAULT_QOS_CLASS])
