"""What one scheduler decided about a case, and every way in which two such verdicts differ."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from campaigns.cluster_cases import Case
from campaigns.reference_scheduler import decide

FOUND = "preemption: found a potential placement"
FAILURE = re.compile(
    r" on device [^/ ]+/([^/ ]+)/[^/ ]+: CEL runtime error|resource pool [^/ ]+/([^/ ]+) is currently (?:being updated|invalid)"
)


@dataclass(frozen=True, slots=True)
class Verdict:
    """`node` is empty for a pod that found none, whose text is `message`; with victims it is the nominated node."""

    node: str = ""
    message: str = ""
    scores: Mapping[str, Mapping[str, int]] = field(default_factory=dict)
    """Feasible node to plugin to weighted score; without scores when a single node was feasible."""
    best: frozenset[str] = frozenset()
    victims: tuple[str, ...] = ()
    """Evicted pods by name, sorted."""
    claims: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Finalizers and status of the pod's ResourceClaims after the decision, by name."""
    next_node: str = ""
    """Where the pod went when its refusal had freed one of its claims; `scores` and `best` are of that attempt then."""

    @property
    def preempts(self) -> bool:
        return FOUND in self.message

    @property
    def feasible(self) -> frozenset[str]:
        return frozenset(self.scores) or (frozenset({self.place}) if self.place else frozenset())

    @property
    def place(self) -> str:
        """The node that the pod was bound to, in the end."""
        return self.next_node if self.message else self.node


def differences(theirs: Verdict, ours: Verdict) -> list[str]:
    """Every way in which the two differ; empty when they agree."""
    found = []
    if theirs.message != ours.message:
        found.append(f"text: theirs {theirs.message!r}, ours {ours.message!r}")
    if theirs.victims != ours.victims:
        found.append(f"victims: theirs {theirs.victims}, ours {ours.victims}")
    if theirs.preempts and theirs.node != ours.node:
        found.append(f"nominated: theirs {theirs.node}, ours {ours.node}")
    # On another of the best nodes there are other devices.
    if theirs.place == ours.place and theirs.claims != ours.claims:
        found.append(f"claims: theirs {theirs.claims}, ours {ours.claims}")
    if theirs.feasible != ours.feasible:
        found.append(f"feasible: theirs {sorted(theirs.feasible)}, ours {sorted(ours.feasible)}")
    elif len(theirs.feasible) > 1:
        found += _scores(theirs, ours)
    return found


def _scores(theirs: Verdict, ours: Verdict) -> list[str]:
    """A plugin that was skipped on one side must have scored 0 on the other."""
    found = []
    for node in sorted(theirs.feasible):
        names = sorted({*theirs.scores[node], *ours.scores[node]})
        pairs = [(name, theirs.scores[node].get(name, 0), ours.scores[node].get(name, 0)) for name in names]
        if unequal := [f"{name} {left}/{right}" for name, left, right in pairs if left != right]:
            found.append(f"scores of {node} (theirs/ours): {', '.join(unequal)}")
    if ours.place not in theirs.best:
        found.append(f"choice: ours {ours.place}, their best {sorted(theirs.best)}")
    return found


def list_failures(*verdicts: Verdict) -> list[tuple[str, str]]:
    """The pool that ended each attempt, by itself or by an expression about a device of it, with the text; none unless all did."""
    matches = [FAILURE.search(verdict.message) for verdict in verdicts]
    return [(match[1] or match[2], match.string) for match in matches if match] if all(matches) else []


def judged(case: Case, theirs: Verdict, ours: Verdict) -> list[str]:
    """`differences`, but for two places of one price: kube-scheduler takes any of them, so each must be among the best.

    Which nodes those are, and who has to go there, is what the scalar reference says.
    """
    unequal = differences(theirs, ours)
    if not unequal or not (theirs.preempts and ours.preempts) or theirs.node == ours.node:
        return unequal
    preemption = decide(case.cluster, case.pod).preemption
    if preemption is None or not {theirs.node, ours.node} <= preemption.best:
        return unequal
    names = {each["metadata"]["uid"]: each["metadata"]["name"] for each in case.cluster.pods}
    for verdict in (theirs, ours):
        expected = sorted(names[uid] for uid in preemption.victims[verdict.node])
        if list(verdict.victims) != expected or not verdict.message.endswith(preemption.tail_for(verdict.node)):
            return unequal
    heads = {each.message.partition(FOUND)[0] for each in (theirs, ours)}
    return [] if len(heads) == 1 else unequal
