"""The state of the cluster at one moment, as one user may read it."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from robotapp_api.values.placement.round_trips import RoundTrips
from robotapp_claims.rules.objects import Claim, ResourceClaim, ResourceSlice
from robotapp_console.views.history import LinkHistory
from robotapp_console.views.links import NodeLinks
from robotapp_console.views.objects import App, Instance, Node, Pod, Pool, Telemetry


@dataclass(frozen=True, slots=True)
class Refusal:
    """A kind that cannot be shown: `what` names it in the plural, `why` is the API server's answer, `cure` a sentence with the next step."""

    what: str
    why: str
    cure: str


@dataclass(frozen=True, slots=True)
class Stale:
    """A kind whose watch is broken: what is shown was true at `since`, a time of the API server's form."""

    what: str
    since: str
    why: str


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The objects by key, `namespace/name` or `name`. A kind that may not be read is empty and stands in `refusals`.

    `namespace` is what the user chose to look at; empty for all.
    """

    namespace: str = ""
    apps: Mapping[str, App] = field(default_factory=dict)
    instances: Mapping[str, Instance] = field(default_factory=dict)
    claims: Mapping[str, Claim] = field(default_factory=dict)
    resource_claims: Mapping[str, ResourceClaim] = field(default_factory=dict)
    """Of all namespaces, whichever the user chose: a device that another one holds is not free."""
    slices: Mapping[str, ResourceSlice] = field(default_factory=dict)
    """Those of our driver: where it runs."""
    pools: Mapping[str, Pool] = field(default_factory=dict)
    telemetry: Mapping[str, Telemetry] = field(default_factory=dict)
    nodes: Mapping[str, Node] = field(default_factory=dict)
    pods: Mapping[str, Pod] = field(default_factory=dict)
    round_trips: RoundTrips = field(default_factory=RoundTrips)
    links: NodeLinks | None = None
    """Links that outlive the snapshot; None: they are computed for it alone."""
    history: LinkHistory = field(default_factory=LinkHistory)
    refusals: Mapping[str, Refusal] = field(default_factory=dict)
    """By the plural of the kind."""
    stale: tuple[Stale, ...] = ()
    now_s: float = 0.0

    def is_silent(self, node: str) -> bool:
        """Returns whether the node's agent has missed three heartbeats: what it measured counts no more."""
        report = self.telemetry.get(node)
        return report is not None and bool(report.written_at) and self.round_trips.silent_from_s(node) <= self.now_s

    def prepare_links(self, zones: Mapping[str, str]) -> NodeLinks:
        """Returns the links of nodes in these zones."""
        links = self.links or NodeLinks(self.round_trips)
        links.use_zones(zones)
        return links

    def list_refusals(self, *plurals: str) -> tuple[Refusal, ...]:
        """Returns the refusals of these kinds, for the panels that need them."""
        return tuple(self.refusals[plural] for plural in plurals if plural in self.refusals)
