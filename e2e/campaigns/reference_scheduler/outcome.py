"""What comes out: the decision, and its texts."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field

from campaigns.reference_scheduler.model import Rejection

NO_NODES = "no nodes available to schedule pods"
NOT_HELPFUL = "Preemption is not helpful for scheduling"
NO_VICTIMS = "No preemption victims found for incoming pod"
Table = dict[str, dict[str, int]]
"""Plugin to node to score."""


@dataclass
class Preemption:
    """Who could make room: victims by node (most important first), and the nodes upstream may choose among.

    More than one node in `best` means upstream's choice among them is random.
    """

    victims: dict[str, list[str]] = field(default_factory=dict)
    """Candidate node to the identities (uid) of its victims."""
    violations: dict[str, int] = field(default_factory=dict)
    """Candidate node to victims whose disruption budget is broken."""
    best: frozenset[str] = frozenset()
    refusals: dict[str, str] = field(default_factory=dict)
    """Node that is no candidate to the text."""
    silent: bool = False
    """A place that was found is not told (1.35)."""
    tail: str = ""
    """The message's last part when the outcome is certain; for candidates see `tail_for`."""

    def tail_for(self, node: str) -> str:
        if self.silent:
            return ""
        count = len(self.victims[node])
        return f"preemption: found a potential placement for pod on node {node}, preempting {count} victims"


@dataclass
class Decision:
    """One pod's decision. Scores are there only when more than one node is feasible.

    message: the whole FailedScheduling text; with several equally good preemption nodes that of the first.
    error: a scheduling error (SchedulerError) instead of a decision.
    """

    feasible: list[str] = field(default_factory=list)
    rejections: dict[str, Rejection] = field(default_factory=dict)
    """Refused node to the first failing plugin with its reasons."""
    promised: bool = False
    """The pod went where it was nominated, and no other node was looked at."""
    refused: Rejection | None = None
    """A PreFilter's refusal, which stands for all nodes."""
    raw: Table = field(default_factory=dict)
    normalized: Table = field(default_factory=dict)
    weighted: Table = field(default_factory=dict)
    totals: dict[str, int] = field(default_factory=dict)
    message: str = ""
    error: str = ""
    preemption: Preemption | None = None

    @property
    def best(self) -> frozenset[str]:
        """The nodes a scheduler may pick."""
        if not self.totals:
            return frozenset(self.feasible)
        top = max(self.totals.values())
        return frozenset(name for name, total in self.totals.items() if total == top)


def histogram(nodes: int, texts: Iterable[str]) -> str:
    """Entries sorted as strings, so "10 x" comes before "2 y"."""
    entries = sorted(f"{count} {text}" for text, count in Counter(texts).items())
    return f"0/{nodes} nodes are available: {', '.join(entries)}."


def fit_message(decision: Decision, nodes: int) -> str:
    """Without the tail."""
    if decision.refused is not None:
        return f"0/{nodes} nodes are available: {', '.join(decision.refused.texts)}."
    return histogram(nodes, (text for each in decision.rejections.values() for text in each.texts))
