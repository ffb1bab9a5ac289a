"""The edges of an instance: each with its time, its budget, what part of the budget is used, and how the time is known."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from math import isinf
from typing import Final

from robotapp_api.values.placement.round_trips import RoundTrips
from robotapp_console.views.links import ZoneEstimates
from robotapp_console.views.objects import EdgeSpec, EdgeStatus
from robotapp_console.views.texts import clean, format_milliseconds, parse_milliseconds

MEDIAN: Final = 50
TIGHT_PERCENT: Final = 70
"""From this part of the budget on an edge is coloured as one to watch."""
UNREACHABLE: Final = "unreachable"
MEASURED, SAME_NODE, ESTIMATED, UNKNOWN = "measured", "same node", "estimated", "unknown"


@dataclass(frozen=True, slots=True)
class EdgeRow:
    """An edge and its budget. `share` is the part of the budget in percent; `verdict` is met, exceeded or empty."""

    topic: str
    source: str
    target: str
    time: str
    budget: str
    knowledge: str
    """How the time is known: measured, same node, estimated or unknown."""
    detail: str = ""
    """The two zones that an estimate is about, or which end is suspended."""
    share: int | None = None
    verdict: str = ""

    @property
    def ends(self) -> str:
        """Returns the two ends as a table names them."""
        return f"{self.source} → {self.target}"

    @property
    def how_known(self) -> str:
        """Returns how the time is known, with the zones of an estimate, or why it is not."""
        return f"{self.knowledge} ({self.detail})" if self.detail else self.knowledge

    @property
    def colour(self) -> str:
        """Returns good, busy (most of the budget is used), bad (exceeded or unreachable) or idle (nothing to compare)."""
        if self.verdict == "exceeded" or self.time == UNREACHABLE or (self.share or 0) > 100:
            return "bad"
        if self.share is None:
            return "good" if self.verdict else "idle"
        return "busy" if self.share >= TIGHT_PERCENT else "good"


class EdgeReader:
    """Makes the rows of an app's edges: what the operator observed counts, and what it had no room for is looked up in telemetry."""

    def __init__(
        self,
        specs: Sequence[EdgeSpec],
        estimates: ZoneEstimates,
        round_trips: RoundTrips,
        suspended: Collection[str] = (),
    ) -> None:
        """`suspended` are components: the operator observes no edge of theirs."""
        self._specs = specs
        self._suspended = suspended
        self._estimates = estimates
        self._round_trips = round_trips
        self._percentiles = {_key(spec): spec.latency.percentile for spec in specs if spec.latency}

    def __repr__(self) -> str:
        return f"<EdgeReader {len(self._specs)} edges>"

    def build_rows(self, statuses: Sequence[EdgeStatus], nodes: Mapping[str, str]) -> tuple[EdgeRow, ...]:
        """Returns the rows of one instance: the operator's, worst first, then those of the spec alone. `nodes` are those of the ends."""
        observed_keys = {_key(status) for status in statuses}
        unobserved_edges = [self._observe(spec, nodes) for spec in self._specs if _key(spec) not in observed_keys]
        return tuple(self._build_row(edge) for edge in (*statuses, *unobserved_edges))

    def _observe(self, spec: EdgeSpec, nodes: Mapping[str, str]) -> EdgeStatus:
        """Returns what can be said of an edge that the status does not have."""
        ends = tuple(node for end in (spec.from_, spec.to) if (node := nodes.get(end, "")))
        budget = spec.latency.budget if spec.latency else None
        figures = self._round_trips.between(*ends) if len(set(ends)) == 2 else None
        time_us = figures.p95_us if figures else None
        return EdgeStatus(
            kind=spec.kind,
            topic=spec.topic,
            from_=spec.from_,
            to=spec.to,
            budget=budget,
            p95=None if time_us is None or isinf(time_us) else f"{time_us:.0f}us",
            measured=figures is not None,
            nodes=ends,
        )

    def _build_row(self, edge: EdgeStatus) -> EdgeRow:
        """Returns the row of an edge. Times are p95 except where a budget is about the median: then only the verdict counts."""
        percentile = self._percentiles.get(_key(edge))
        budget, p95 = parse_milliseconds(edge.budget), parse_milliseconds(edge.p95)
        is_unreachable = edge.measured and p95 is None
        knowledge, detail = MEASURED if edge.measured else UNKNOWN if p95 is None else SAME_NODE, ""
        if p95 is None and not is_unreachable and len(set(edge.nodes)) == 2:
            estimate = self._estimates.estimate(edge.nodes[0], edge.nodes[1])
            if estimate is not None:
                p95, knowledge, detail = estimate[0] / 1000, ESTIMATED, ", ".join(dict.fromkeys(estimate[1]))
        if knowledge == UNKNOWN:
            detail = self._describe_suspended(edge)
        if is_unreachable:
            time, share = UNREACHABLE, None
        else:
            time = "" if p95 is None else f"{format_milliseconds(p95)} ms"
            share = round(100 * p95 / budget) if p95 is not None and budget and percentile != MEDIAN else None
        kind = "" if edge.kind == "Topic" else f" ({edge.kind})"
        median = ", median" if percentile == MEDIAN else ""
        return EdgeRow(
            clean(f"{edge.topic}{kind}", 255),
            clean(edge.from_, 70),
            clean(edge.to, 70),
            time,
            f"{format_milliseconds(budget)} ms{median}" if budget else "",
            knowledge,
            clean(detail, 160),
            share,
            "" if edge.met is None else "met" if edge.met else "exceeded",
        )

    def _describe_suspended(self, edge: EdgeStatus) -> str:
        """Returns which ends are suspended, in words; empty for none."""
        names = [end for end in dict.fromkeys((edge.from_, edge.to)) if end in self._suspended]
        return f"{' and '.join(names)} {'is' if len(names) == 1 else 'are'} suspended" if names else ""


def _key(edge: EdgeSpec | EdgeStatus) -> tuple[str, str, str, str]:
    return edge.kind, edge.topic, edge.from_, edge.to
