"""LatencyFilter: nodes that are too far from the other ends of a pod's connections, or on whose links these do not fit."""

from collections.abc import Sequence
from typing import Annotated, Final

import msgspec
import numpy as np

from robotapp_api.model.names import Annotation
from robotapp_api.values.quantities.duration import parse_us
from robotapp_scheduler.core.api.ros import Endpoint
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.events.cluster_event import Change
from robotapp_scheduler.core.framework.argument_words import check_word, one_of
from robotapp_scheduler.core.framework.interface import FilterResult, Verdict
from robotapp_scheduler.core.nodes.columns import BoolArray, FloatArray, IntArray
from robotapp_scheduler.core.nodes.node_facts import NodeFact
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.robotics.access_links import LINK_BANDWIDTH
from robotapp_scheduler.joint.link_limits import overloading
from robotapp_scheduler.plugins.ros.round_trips import estimated, nearest_us, tightest

DRAINING: Final = "node(s) were shutting down gracefully"
TOO_FAR: Final = "node(s) exceeded the latency budget"
LIKELY_TOO_FAR: Final = "node(s) exceeded the latency budget by estimate"
UNKNOWN: Final = "node(s) had no latency measurement"
OUTLIER: Final = "node(s) were latency outliers"
NO_END: Final = "node(s) couldn't be measured to the other end of the latency budget: it is not known"
NO_BANDWIDTH: Final = "node(s) left too little bandwidth on an access link for the pod's connections"
UNREACHABLE: Final = "node(s) got no answer from the other end of a connection"
SHUTTING_DOWN: Final = NodeFact(
    "shutting-down",
    lambda node: (node.metadata.annotations or {}).get(Annotation.GRACEFUL_SHUTDOWN) == "true",
    absent=False,
)
"""No new ROS pods on these."""
_PASS, _DRAINING, _TOO_FAR, _UNKNOWN, _OUTLIER, _UNREACHABLE, _LIKELY_TOO_FAR, _NO_END, _NO_BANDWIDTH = range(-1, 8)

UNKNOWN_RULES: Final = ("Allow", "Deny")


class LatencyFilterArgs(msgspec.Struct, frozen=True, forbid_unknown_fields=True, rename="camel"):
    """maxLatency: budget of connections that have none. outlierFactor: nodes this many times slower than the median are refused; 0 = off."""

    max_latency: str = "100ms"
    unknown: Annotated[str, one_of(UNKNOWN_RULES)] = "Allow"
    outlier_factor: float = 0.0


class LatencyFilter:
    """RTT between the candidate and where each placed peer or the robot is, at the edge's percentile.

    `most_us` and `deny_unknown` are read by the joint planner as well (core.cycle.joint_problem.LimitsConnections).
    """

    name = "LatencyFilter"
    reads = ("ros.endpoints", "ros.links")
    node_reads = ("rtt", SHUTTING_DOWN, LINK_BANDWIDTH)
    events = (
        Change.NODE_ADDED | Change.ANNOTATIONS | Change.LABELS  # which zone a node is in, which one is `@robot`, what links carry
        | Change.RTT | Change.POD_ADDED | Change.POD_REMOVED | Change.APPS
    )  # fmt: skip
    resolvable = False
    Args = LatencyFilterArgs

    def __init__(self, args: LatencyFilterArgs | None = None) -> None:
        args = args or LatencyFilterArgs()
        check_word("unknown", args.unknown, UNKNOWN_RULES)
        if not 0.0 <= args.outlier_factor <= 1000.0:
            raise ValueError("outlierFactor: not in valid range [0-1000]")
        self.most_us = parse_us(args.max_latency)
        self.deny_unknown = args.unknown == "Deny"
        self._outlier_factor = args.outlier_factor
        # The median of all nodes is part of an outlier's verdict: then no row stands alone.
        self.row_local = args.outlier_factor == 0.0

    def filter(self, pod: PodInfo, nodes: Snapshot) -> FilterResult:
        """True where every rule is met; Skip for a pod without ROS fields."""
        if pod.ros is None:
            return None
        codes = np.where(nodes.fact(SHUTTING_DOWN), _DRAINING, _PASS)
        detail = np.full(nodes.n, np.nan)
        required = (endpoint for endpoint in pod.ros.endpoints if endpoint.required)
        for endpoint in tightest(required, default_us=self.most_us):
            self._judge(nodes, endpoint, codes, detail)
        if self.deny_unknown and pod.ros.unknown_end:
            self._mark(codes, np.ones(nodes.n, dtype=np.bool_), _NO_END)
        if pod.ros.flows:
            self._mark(codes, _overloading(pod.ros.flows, nodes), _NO_BANDWIDTH)
        mask = np.equal(codes, _PASS)
        reasons = (
            (DRAINING,),
            (TOO_FAR,),
            (UNKNOWN,),
            (OUTLIER,),
            (UNREACHABLE,),
            (LIKELY_TOO_FAR,),
            (NO_END,),
            (NO_BANDWIDTH,),
        )
        return Verdict(mask, np.maximum(codes, 0), reasons, detail=detail, detail_unit="ms")

    def _judge(self, nodes: Snapshot, endpoint: Endpoint, codes: IntArray, detail: FloatArray) -> None:
        rtt_us = nearest_us(nodes, endpoint)
        budget_us = self.most_us if endpoint.budget_us is None else endpoint.budget_us
        lost = np.isinf(rtt_us)
        self._mark(codes, lost, _UNREACHABLE)
        far = (rtt_us > budget_us) & ~lost  # NaN is never greater: unknown is judged below
        np.fmax(detail, rtt_us / 1000.0, out=detail, where=far)
        if far.any():
            guessed = estimated(nodes, endpoint, rtt_us)
            self._mark(codes, far & ~guessed, _TOO_FAR)
            self._mark(codes, far & guessed, _LIKELY_TOO_FAR)
        if self.deny_unknown:
            self._mark(codes, np.isnan(rtt_us), _UNKNOWN)
        if self._outlier_factor > 0.0:
            known = rtt_us[np.isfinite(rtt_us) & nodes.valid]
            if len(known):
                self._mark(codes, rtt_us > self._outlier_factor * float(np.median(known)), _OUTLIER)

    @staticmethod
    def _mark(codes: IntArray, where: BoolArray, code: int) -> None:
        codes[where & (codes == _PASS)] = code


def _overloading(flows: Sequence[tuple[str, int]], nodes: Snapshot) -> BoolArray:
    """Nodes with which a link would carry more than is known to be left on it."""
    free_bps, row_of = nodes.cluster.links.free(), nodes.cluster.nodes.row_of
    if free_bps is None:
        return np.zeros(nodes.n, dtype=np.bool_)
    peers: dict[int, int] = {}
    for node, bps in flows:
        row = row_of.get(node)
        if row is not None:
            peers[row] = peers.get(row, 0) + bps
    blocked: BoolArray = nodes.pick(overloading(free_bps, peers))
    return blocked
