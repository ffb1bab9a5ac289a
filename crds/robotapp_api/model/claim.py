"""RobotClaim: one claimed thing. The object's name is the thing, so creating it is taking it."""

from typing import Annotated, ClassVar, Final, Literal

from pydantic import Field, StringConstraints

from robotapp_api.model import names
from robotapp_api.model.base import Model, ObjectMeta, Observed
from robotapp_api.model.markers import Column, Kind, ListSet, Rule
from robotapp_api.model.scalars import (
    AppName,
    DnsLabel,
    DomainId,
    Generation,
    NodeName,
    ShortText,
    Text,
    Token,
)

Scope = Literal["Cluster", "Zone", "Node"]
MAX_NODES: Final = 1000
PhaseName = Literal["Reserved", "Draining", "Parked"]


class DomainThing(Model):
    """A DDS domain id of a pool."""

    RULES = (
        Rule(
            rule="(self.scope == 'Cluster') == (self.scopeValue == '')",
            message="scopeValue names the zone or node; write it for scope Zone and Node, and leave it empty for Cluster",
            path=".scopeValue",
        ),
    )

    pool: AppName
    """DomainPool the id belongs to."""
    scope: Scope
    """Range within which the id is unique, as the pool says."""
    scope_value: Text = ""
    """Zone or node of the scope; empty for Cluster."""
    id: DomainId
    """Domain id."""


class DeviceThing(Model):
    """A device of a node."""

    node: NodeName
    """Node the device is attached to."""
    type: Token
    """Type of device, such as can."""
    id: DnsLabel
    """Id under which the node's agent reports the device."""
    identity: Annotated[str, StringConstraints(max_length=128)] = ""
    """What stays the same when the device is plugged in elsewhere, such as usb:1d50:606f:00A1."""


class Holder(Model):
    """Who holds the thing."""

    api_version: Annotated[str, StringConstraints(min_length=1, max_length=128)]
    """API version of the holder, such as robotics.io/v1alpha1, or v1 for a bare pod."""
    kind: Annotated[str, StringConstraints(min_length=1, max_length=63)]
    """RobotApp or Pod."""
    namespace: Annotated[str, StringConstraints(min_length=1, max_length=63)]
    """Namespace of the holder."""
    name: Annotated[str, StringConstraints(min_length=1, max_length=253)]
    """Name of the holder."""
    uid: Annotated[str, StringConstraints(min_length=1, max_length=36)]
    """Uid of the holder; another object of the same name is another holder."""
    instance: ShortText = ""
    """Instance (robot) of the RobotApp; empty for bare pods and apps without robots."""
    component: ShortText = ""
    """Component that holds a device; empty for domains and bare pods."""


class ClaimSpec(Model):
    """What is claimed by whom."""

    RULES = (
        Rule(
            rule="self == oldSelf",
            message="a claim never changes its thing or its holder; delete it and create another",
            reason="FieldValueForbidden",
        ),
        Rule(rule="has(self.domain) != has(self.device)", message="write exactly one of domain and device"),
    )

    domain: DomainThing | None = None
    """Claimed domain id; exactly one of domain and device is present."""
    device: DeviceThing | None = None
    """Claimed device; exactly one of domain and device is present."""
    holder: Holder
    """Who holds the thing."""


class ClaimStatus(Observed):
    """How far the claim is."""

    STORED: ClassVar = frozenset({"phase"})

    phase: PhaseName = "Reserved"
    """Reserved for its holder, whether or not its pods run, Draining before it is free, or Parked: its pods are gone from the
    API server, but a node of `nodes` that is out of sight may still run them."""
    attempt: Generation = 0
    """Times the holder adopted the claim; raised so that stale writers lose."""
    node: Text = ""
    """Node the thing is used on."""
    pod: Annotated[str, StringConstraints(max_length=36)] = ""
    """Uid of the pod that uses the device."""
    nodes: Annotated[tuple[NodeName, ...], ListSet(), Field(max_length=MAX_NODES)] = ()
    """Nodes where pods with the claimed domain may run. Written before each of them is bound, struck off when the node, in
    contact, runs none."""


class RobotClaim(Model):
    """One claimed thing: a DDS domain id or a device. Its name is the thing, so only one holder can exist."""

    RULES = (
        Rule(
            rule=(
                "!has(self.spec.domain) || (self.metadata.name.matches('^dds[.][a-z0-9-]{1,40}[.](c|[nz][0-9a-f]{10})[.](0|[1-9][0-9]{0,2})$')"
                " && self.metadata.name.split('.')[1] == self.spec.domain.pool"
                " && self.metadata.name.split('.')[2].startsWith(self.spec.domain.scope == 'Cluster' ? 'c' : self.spec.domain.scope == 'Zone' ? 'z' : 'n')"
                " && self.metadata.name.split('.')[3] == string(self.spec.domain.id))"
            ),
            message="the name is the lock: write metadata.name dds.<pool>.<c, n<hash> or z<hash>>.<id> as spec.domain says, for example dds.default.c.7",
        ),
        Rule(
            rule="!has(self.spec.device) || (self.metadata.name.matches('^dev[.]n[0-9a-f]{10}[.][-a-z0-9]{1,63}$') && self.metadata.name.split('.')[2] == self.spec.device.id)",
            message="the name is the lock: write metadata.name dev.n<hash of the node>.<id> as spec.device says, for example dev.n0123456789.can-can0",
        ),
    )
    CRD: ClassVar = Kind(
        plural="robotclaims",
        singular="robotclaim",
        short_names=("rclaim",),
        namespaced=False,
        columns=(
            Column("HolderKind", ".spec.holder.kind"),
            Column("Thing", r".metadata.annotations.robotics\.io/thing"),
            Column("Holder", r".metadata.annotations.robotics\.io/holder"),
            Column("Instance", ".spec.holder.instance"),
            Column("Node", ".spec.device.node"),
            Column("Phase", ".status.phase"),
            Column("Age", ".metadata.creationTimestamp", type="date"),
        ),
        selectable=(
            ".spec.holder.uid",
            ".spec.holder.instance",
            ".spec.holder.namespace",
            ".spec.domain.pool",
            ".spec.device.node",
            ".status.phase",
        ),
    )

    api_version: Literal["robotics.io/v1alpha1"] = names.API_VERSION
    """Version of the schema this object is written in."""
    kind: Literal["RobotClaim"] = "RobotClaim"
    """Kind of this object."""
    metadata: ObjectMeta = ObjectMeta()
    """Name, labels and annotations; the name is the claimed thing."""
    spec: ClaimSpec
    """What is claimed by whom; never changes."""
    status: ClaimStatus = ClaimStatus()
    """How far the claim is."""
