"""NodeTelemetry: what one node's agent measured. Named after the node."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field, StringConstraints, WithJsonSchema

from robotapp_api.model import names
from robotapp_api.model.base import Model, ObjectMeta, Observed
from robotapp_api.model.markers import Column, Kind, ListSet
from robotapp_api.model.scalars import DnsLabel, Generation, Microseconds, NodeName, Percent, ShortText, Token


def node_owner(*, name: str, uid: str) -> dict[str, str]:
    """The owner reference of a NodeTelemetry: it goes with its node, and a node of the same name begins with none."""
    return {"apiVersion": "v1", "kind": "Node", "name": name, "uid": uid}


class TelemetrySpec(Model):
    """What the agent is asked to measure."""

    probe: Annotated[tuple[NodeName, ...], ListSet(), Field(max_length=16)] = ()
    """Nodes to measure in every round (more than 14 of them: each in at least every second round): the other ends of placed
    edges. Written by the operator."""


class Kernel(Observed):
    """Kernel of the node."""

    realtime: bool = False
    """The kernel is built with PREEMPT_RT."""


HardwareName = Annotated[
    str, StringConstraints(min_length=1, max_length=63, pattern=r"^[a-z0-9]([-A-Za-z0-9_.]*[A-Za-z0-9])?$")
]
"""The part of a label hardware.robotics.io/<type>[-<interface>] after the slash."""


class TelemetryDevice(Observed):
    """A device attached to the node."""

    id: DnsLabel
    """Id that stays the same when the device is unplugged and plugged in again."""
    type: Token
    """Type of device, such as usb, can, serial or gpio."""
    model: ShortText = ""
    """Model of the device, written as a label value."""
    interface: ShortText = ""
    """The kernel's name of the device where it belongs to the hardware, such as can0 or gpiochip0."""
    identity: Annotated[str, StringConstraints(max_length=128)] = ""
    """Vendor, product and serial, such as 8086:0b3a:0123."""
    present: bool
    """The device is attached now."""
    path: Annotated[str, StringConstraints(max_length=255)] = ""
    """Device file, such as /dev/video0."""
    names: Annotated[tuple[HardwareName, ...], Field(max_length=8)] = ()
    """Further names <type>[-<interface>] under which requirements and devices find it, such as usb or sensor-usb-cam. Its id,
    and so its claim, is the same under each."""


class Rtt(Observed):
    """Round-trip time to another node. Without times: no probe was answered, which exceeds every budget."""

    peer: NodeName
    """Node at the other end."""
    p50_us: Annotated[Microseconds | None, Field(alias="p50Us")] = None
    """Median round-trip time in microseconds."""
    p95_us: Annotated[Microseconds | None, Field(alias="p95Us")] = None
    """95th percentile of the round-trip time in microseconds."""
    jitter_us: Annotated[Microseconds | None, Field(alias="jitterUs")] = None
    """Mean difference between one round-trip time and the next, in microseconds; absent with fewer than two answers."""
    loss_ppm: Annotated[int | None, Field(alias="lossPPM", ge=0, le=1_000_000)] = None
    """Probes that got no answer, per million, over the last rounds in which there was any answer."""
    seq: Generation | None = None
    """Number of the round that measured this pair; absent means that of the status. Writing the same round again does not
    refresh the entry."""
    every_rounds: Annotated[int | None, Field(ge=1, le=100_000)] = None
    """Rounds from one measurement of this pair to the next; absent means every round. The entry is unknown when three times
    as many heartbeats, or a day, have passed since the reader first received its round."""


class Load(Observed):
    """How busy the node is."""

    cpu_percent: Percent | None = None
    """CPU in use, in percent of all cores."""
    memory_percent: Percent | None = None
    """Memory in use, in percent."""
    disk_percent: Percent | None = None
    """Disk space in use, in percent: the filesystem of the kubelet, else that of the root folder."""
    gpu_percent: Percent | None = None
    """GPU in use, in percent; absent without a GPU."""
    network_bps: Annotated[Generation | None, Field(alias="networkBps")] = None
    """Traffic in both directions over the node's physical interfaces, in bit/s."""


class Temperature(Observed):
    """A temperature sensor of the node."""

    name: Annotated[str, StringConstraints(min_length=1, max_length=63)]
    """Name that the kernel gives the sensor, such as cpu-thermal."""
    celsius: Annotated[int, Field(ge=-273, le=1000)]
    """Temperature in degrees Celsius."""


class Battery(Observed):
    """The batteries of the node."""

    percent: Percent
    """Charge that is left, in percent."""
    charging: bool
    """The node is on external power."""


class Clock(Observed):
    """The node's clock."""

    offset_milliseconds: Annotated[int, WithJsonSchema({"type": "integer", "format": "int64"})]
    """How far the node's clock is ahead of the API server's, in milliseconds; negative when it is behind. The API server tells
    its time in whole seconds, so the value is right within three seconds and changes only when the clock does."""


class TelemetryStatus(Observed):
    """What the agent of the node measured; it alone writes it."""

    interval_seconds: Annotated[int, Field(ge=1, le=3600)] | None = None
    """Heartbeat of the agent, which measures one round in each; absent means 10. When no new round came for three of them the
    load is unknown."""
    seq: Generation | None = None
    """Number of the latest round; readers count the age of a round from when they first receive it, by their own clock."""
    arch: Annotated[str, StringConstraints(max_length=32)] = ""
    """CPU architecture, such as arm64."""
    kernel: Kernel | None = None
    """Kernel of the node."""
    devices: Annotated[tuple[TelemetryDevice, ...], Field(max_length=128)] = ()
    """Devices attached to the node."""
    device_problem: Annotated[str, StringConstraints(max_length=256)] = ""
    """What is wrong with the rules for the node's devices, or could not be read; empty when nothing is."""
    rtt: Annotated[tuple[Rtt, ...], Field(max_length=64)] = ()
    """Round-trip times to other nodes."""
    load: Load | None = None
    """How busy the node is."""
    temperatures: Annotated[tuple[Temperature, ...], Field(max_length=16)] = ()
    """Temperature sensors."""
    battery: Battery | None = None
    """Charge of the node's batteries; absent without one."""
    clock: Clock | None = None
    """The node's clock compared with the API server's; absent while unknown."""


class NodeTelemetry(Model):
    """Round-trip times, devices and load of one node. Its name is the node's name, and the node owns it."""

    CRD: ClassVar = Kind(
        plural="nodetelemetries",
        singular="nodetelemetry",
        short_names=("ntel",),
        namespaced=False,
        columns=(
            Column("Arch", ".status.arch"),
            Column("Realtime", ".status.kernel.realtime", type="boolean"),
            Column("CPU%", ".status.load.cpuPercent", type="integer"),
            Column("Mem%", ".status.load.memoryPercent", type="integer"),
            Column("Battery%", ".status.battery.percent", type="integer"),
            Column("Interval", ".status.intervalSeconds", type="integer"),
            Column("Age", ".metadata.creationTimestamp", type="date"),
            Column("Disk%", ".status.load.diskPercent", type="integer", wide=True),
            Column("GPU%", ".status.load.gpuPercent", type="integer", wide=True),
            Column("Clock offset ms", ".status.clock.offsetMilliseconds", type="integer", wide=True),
            Column("Seq", ".status.seq", type="integer", wide=True),
        ),
    )

    api_version: Literal["robotics.io/v1alpha1"] = names.API_VERSION
    """Version of the schema this object is written in."""
    kind: Literal["NodeTelemetry"] = "NodeTelemetry"
    """Kind of this object."""
    metadata: ObjectMeta = ObjectMeta()
    """Name, labels and annotations; the name is the node's."""
    spec: TelemetrySpec = TelemetrySpec()
    """What the agent is asked to measure."""
    status: TelemetryStatus = TelemetryStatus()
    """What the agent measured."""
