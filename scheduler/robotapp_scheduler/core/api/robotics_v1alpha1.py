"""The robotics.io objects as the scheduler reads them: slim structs beside `core_v1.py`.

`robotapp_api.model` is the full, validated form; on the scheduler's hot path only the fields that decide a placement
are decoded. Durations stay Go strings here and are parsed once per app in `robotics/app_index.py`. A RobotClaim and a component's
devices are read as the claim rules read them, `robotapp_claims.rules.objects`.
"""

from typing import Any

import msgspec

from robotapp_api.values.placement.round_trips import Rtt
from robotapp_claims.rules.objects import DeviceRequirement, TelemetryDevice
from robotapp_scheduler.core.api.core_v1 import Metadata
from robotapp_scheduler.core.api.ros import Hardware
from robotapp_scheduler.core.api.structs import Slim, SlimValue


class ComponentPolicies(Slim):
    """components[].policies: the thesis' fields."""

    latency_budget: str = ""
    deadline: str = ""
    reliability: str = ""
    liveliness: str = ""


class SharedData(Slim):
    """components[].sharedData."""

    with_: tuple[str, ...] = msgspec.field(name="with", default=())
    peer_pods: tuple[str, ...] = ()
    claim_names: tuple[str, ...] = ()


class Dependency(Slim):
    """components[].dependsOn[]: the operator reads its state."""

    component: str = ""


class Component(Slim):
    """One component of a RobotApp: one Deployment per instance, or one Job."""

    name: str = ""
    runs_on: tuple[str, ...] = ()
    """Allowed tiers, best first; empty = any node."""
    qos_class: str = "system_default"
    policies: ComponentPolicies = msgspec.field(default_factory=ComponentPolicies)
    devices: tuple[DeviceRequirement, ...] = ()
    requires: tuple[Hardware, ...] = ()
    shared_data: SharedData = msgspec.field(default_factory=SharedData)
    colocate_with: tuple[str, ...] = ()
    separate_from: tuple[str, ...] = ()
    depends_on: tuple[Dependency, ...] = ()
    replicas: int = 1
    replica_identity: str = ""
    job: dict[str, Any] | None = None
    """The component ends."""
    on_disconnect: str = ""


class RecordingVolume(Slim):
    """recordings[].volume."""

    claim_name: str = ""


class Recording(Slim):
    """One recording: a component of its name."""

    name: str = ""
    tiers: tuple[str, ...] = ()
    volume: RecordingVolume = msgspec.field(default_factory=RecordingVolume)


class EdgeLatency(Slim):
    """edges[].latency."""

    budget: str = ""
    percentile: int = 95
    enforce: str = "Required"


class Edge(Slim):
    """A topic, service or action between two components, or a component and the robot's node (`@robot`)."""

    kind: str = "Topic"
    topic: str = ""
    from_: str = msgspec.field(name="from", default="")
    to: str = ""
    rate_hz: str | int | None = None
    message_bytes: int | None = None
    latency: EdgeLatency | None = None
    bandwidth: str | int | None = None


class Reschedule(Slim):
    """spec.placement.reschedule, as far as the scheduler reads it: how often anything moves is the operator's."""

    when: str = "Never"
    for_: str = msgspec.field(name="for", default="15s")
    max_per_day: int = 3
    """Read for what-if alone: with 0 nothing moves."""


class Fallback(Slim):
    """spec.placement.fallback."""

    steps: tuple[str, ...] = ("RelaxPreferred", "Wait")
    after: str = "10s"


class Placement(Slim):
    """spec.placement."""

    zones: tuple[str, ...] = ()
    master_node: str = ""
    objective: str = "Latency"
    gang: str = "All"
    fallback: Fallback | None = None
    """None: Preferred budgets are never more than a cost."""
    reschedule: Reschedule = msgspec.field(default_factory=Reschedule)


class RobotAppSpec(Slim):
    """spec of a RobotApp as far as placement needs it."""

    suspend: bool = False
    components: tuple[Component, ...] = ()
    edges: tuple[Edge, ...] = ()
    recordings: tuple[Recording, ...] = ()
    placement: Placement = msgspec.field(default_factory=Placement)


class ObservedStatus(Slim):
    """status of a RobotApp: the operator has seen this generation."""

    observed_generation: int = 0


class RobotApp(Slim):
    """robotics.io RobotApp."""

    metadata: Metadata = msgspec.field(default_factory=Metadata)
    spec: RobotAppSpec = msgspec.field(default_factory=RobotAppSpec)
    status: ObservedStatus = msgspec.field(default_factory=ObservedStatus)


# --- NodeTelemetry ---------------------------------------------------------------------------------------------------


class Load(SlimValue, frozen=True):
    """Load of the node in per cent; absent values are None."""

    cpu_percent: int | None = None
    memory_percent: int | None = None
    gpu_percent: int | None = None


class TelemetryStatus(Slim):
    """status of a NodeTelemetry, written by that node's agent alone."""

    interval_seconds: int | None = None
    seq: int | None = None
    devices: tuple[TelemetryDevice, ...] = ()
    rtt: tuple[Rtt, ...] = ()
    load: Load | None = None


class NodeTelemetry(Slim):
    """robotics.io NodeTelemetry; its name is the node's."""

    metadata: Metadata = msgspec.field(default_factory=Metadata)
    status: TelemetryStatus = msgspec.field(default_factory=TelemetryStatus)
