"""DomainPool: the domain ids of one network whose participants can hear each other."""

from typing import Annotated, ClassVar, Final, Literal

from pydantic import Field, StringConstraints

from robotapp_api.model import names
from robotapp_api.model.base import Model, ObjectMeta, Observed
from robotapp_api.model.claim import Scope
from robotapp_api.model.conditions import Conditions
from robotapp_api.model.markers import Column, Kind, ListSet, Rule
from robotapp_api.model.scalars import Count, DomainId, Generation

DEFAULT_IDS = names.SAFE_IDS
DEFAULT_PARTICIPANTS: Final = 50
Ids = Annotated[
    str,
    StringConstraints(max_length=128, pattern=r"^([0-9]{1,3}(-[0-9]{1,3})?(,[0-9]{1,3}(-[0-9]{1,3})?){0,31})?$"),
]
Network = Annotated[str, StringConstraints(max_length=63, pattern=r"^([a-z0-9]([-a-z0-9]*[a-z0-9])?)?$")]
_MOST_RANGES: Final = 32
Limit = Annotated[int, Field(ge=0, le=233)]
NamespaceLimits = Annotated[
    dict[str, Limit],
    Field(max_length=256),
    Rule(
        rule="self.all(k, k.matches('^[a-z0-9]([-a-z0-9]{0,61}[a-z0-9])?$'))",
        message="keys must be names of namespaces, for example team-a: 10",
    ),
]


def _ascending(field: str, example: str) -> Rule:
    """Each range ends where it begins or later, and before the next one begins.

    The positions are written out, because CEL has no other way to look at a neighbour in a list.
    """
    ranges = f"self.{field}.split(',', 32)"
    positions = list(range(_MOST_RANGES - 1))
    ordered = f"{ranges}.all(r, {_first('r')} <= {_last('r')} && {_last('r')} <= 232)"
    apart = f"{positions}.all(i, i + 1 >= size({ranges}) || {_last(f'{ranges}[i]')} < {_first(f'{ranges}[i + 1]')})"
    return Rule(
        rule=f"self.{field} == '' || ({ordered} && {apart})",
        message=f"{field} must be ascending ranges without overlap, up to 232; write for example {example}",
        path=f".{field}",
    )


def _first(name: str) -> str:
    return f"int({name}.split('-')[0])"


def _last(name: str) -> str:
    return f"int({name}.split('-')[size({name}.split('-')) - 1])"


class Quota(Model):
    """How many ids a namespace may hold."""

    default: Limit | None = None
    """Ids each namespace may hold unless it is named below; absent means no limit, 0 means none."""
    namespaces: NamespaceLimits = Field(default_factory=dict)
    """Ids single namespaces may hold; 0 means none."""


class PoolSpec(Model):
    """Which ids exist, who may have how many, and how long they rest."""

    RULES = (
        _ascending("ids", DEFAULT_IDS),
        _ascending("sharedIds", "90-101"),
        Rule(
            rule=f"self.ids == '' || self.sharedIds == '' || self.ids.split(',', 32).all(a, self.sharedIds.split(',', 32).all(b, {_last('a')} < {_first('b')} || {_last('b')} < {_first('a')}))",
            message="an id is either claimed or shared; write ids and sharedIds that do not overlap",
            expression="'ids %s and sharedIds %s overlap, but an id is either claimed or shared; take the common ones out of one of them'.format([self.ids, self.sharedIds])",
            path=".sharedIds",
        ),
    )

    scope: Annotated[
        Scope,
        Rule(
            rule="self == oldSelf",
            message="scope cannot change, because claims are named after it; create another pool",
            reason="FieldValueForbidden",
        ),
    ] = "Cluster"
    """Range within which an id is unique: the Cluster, a Zone or a Node."""
    network: Network = ""
    """Name of the network whose participants hear each other. Pools of one network may not list the same ids: the younger one gives
    no ids then. Empty is a network, too, that of all pools without a name; only networks that cannot hear each other have several names.
    """
    ids: Ids = DEFAULT_IDS
    """Ids that are claimed exclusively, as ascending ranges."""
    shared_ids: Ids = ""
    """Ids for isolation Discovery: used by several apps, never claimed."""
    reserved: Annotated[tuple[DomainId, ...], ListSet(), Field(max_length=233)] = (0,)
    """Ids nobody gets, not even who asks for one by number, for example those of robots outside the cluster."""
    quarantine_seconds: Annotated[int, Field(ge=0, le=86_400)] = 60
    """Seconds an id rests before somebody else gets it; DDS leases of the old participants must run out."""
    quota: Quota = Quota()
    """How many ids a namespace may hold."""
    max_participants_per_host: Annotated[int, Field(ge=1, le=120)] = DEFAULT_PARTICIPANTS
    """DDS participants one host can carry within a domain; the port rules of DDS allow 120 at most. Not used yet: no pod is
    refused because of it."""


class PoolStatus(Observed):
    """How full the pool is."""

    observed_generation: Generation | None = None
    """Generation of the spec this status is about."""
    capacity: Count = 0
    """Ids that can be claimed, in each zone or node where that is the scope."""
    claimed: Count = 0
    """Ids that are claimed, resting ones included."""
    quarantined: Count = 0
    """Ids that rest before they are free."""
    used: Annotated[str, StringConstraints(max_length=16)] = ""
    """Claimed and possible ids, such as 12/119; of the fullest zone or node where that is the scope."""
    conditions: Conditions = ()
    """What is wrong with the pool."""


class DomainPool(Model):
    """DDS domain ids of one network. A network belongs to exactly one pool."""

    RULES = (
        Rule(
            rule="self.metadata.name.matches('^[a-z0-9]([-a-z0-9]{0,38}[a-z0-9])?$')",
            message="names of claims contain the pool's name; write a DNS label of at most 40 characters, for example default",
        ),
    )
    CRD: ClassVar = Kind(
        plural="domainpools",
        singular="domainpool",
        short_names=("dpool",),
        namespaced=False,
        columns=(
            Column("Scope", ".spec.scope"),
            Column("Ids", ".spec.ids"),
            Column("Used", ".status.used"),
            Column("Age", ".metadata.creationTimestamp", type="date"),
            Column("Shared", ".spec.sharedIds", wide=True),
        ),
    )

    api_version: Literal["robotics.io/v1alpha1"] = names.API_VERSION
    """Version of the schema this object is written in."""
    kind: Literal["DomainPool"] = "DomainPool"
    """Kind of this object."""
    metadata: ObjectMeta = ObjectMeta()
    """Name, labels and annotations."""
    spec: PoolSpec
    """Which ids exist, who may have how many, and how long they rest."""
    status: PoolStatus = PoolStatus()
    """How full the pool is."""
