"""Outcome of a campaign: counts per family, and every difference with what is needed to replay it."""

from collections import Counter
from dataclasses import dataclass, field
from typing import Any

from campaigns.cluster_cases import Case
from campaigns.parity.verdict import Verdict

Json = dict[str, Any]
OUTCOMES = ("compared", "bound", "refused", "preempted", "invalid", "differences")


@dataclass
class Report:
    """families: family at the centre to outcome to cases. invalid: family to an answer of the API server."""

    seed: str
    families: dict[str, Counter[str]] = field(default_factory=dict)
    compared: Counter[str] = field(default_factory=Counter)
    invalid: dict[str, str] = field(default_factory=dict)
    found: list[Json] = field(default_factory=list)
    seconds: float = 0.0

    @property
    def cases(self) -> int:
        """Those that both schedulers decided."""
        return self.compared["cases"]

    def refused_by_server(self, case: Case, why: str) -> None:
        self._of(case)["invalid"] += 1
        self.invalid.setdefault(case.families[0], why)

    def take(self, case: Case, theirs: Verdict | None = None) -> None:
        """Counts a case and, where the other side has a verdict, what was compared in it."""
        if theirs is None:
            self._of(case)["compared"] += 1
            self.compared["cases"] += 1
            return
        outcome = "preempted" if theirs.preempts else "refused" if theirs.message else "bound"
        self._of(case)[outcome] += 1
        nodes = sum(1 for each in case.objects if each["kind"] == "Node")
        self.compared["cases"] += 1
        self.compared[outcome] += 1
        self.compared["first reasons on one node"] += nodes == 1 and bool(theirs.message)
        self.compared["scores of all plugins"] += len(theirs.scores) > 1
        self.compared["feasible sets"] += not theirs.message
        self.compared["texts"] += bool(theirs.message)
        self.compared["resource claims as written"] += bool(theirs.claims)

    def differs(self, case: Case, found: Json) -> None:
        self._of(case)["differences"] += 1
        self.found.append(found)

    def table(self) -> str:
        outcomes = [name for name in OUTCOMES if any(counts[name] for counts in self.families.values())]
        rows = [f"{'family':26}" + "".join(f"{name:>12}" for name in outcomes)]
        for family, counts in sorted(self.families.items()):
            rows.append(f"{family:26}" + "".join(f"{counts[name]:12}" for name in outcomes))
        return "\n".join(rows)

    def summary(self) -> str:
        parts = ", ".join(f"{count} {name}" for name, count in self.compared.items() if name != "cases")
        return (
            f"{self.cases} cases of {len(self.families)} families, seed {self.seed}: {len(self.found)} differences"
            f"{f' ({parts})' if parts else ''}, {self.seconds:.0f} s"
        )

    def as_json(self) -> Json:
        return {
            "seed": self.seed,
            "seconds": self.seconds,
            "compared": dict(self.compared),
            "families": {name: dict(counts) for name, counts in sorted(self.families.items())},
            "invalid": self.invalid,
            "differences": self.found,
        }

    def _of(self, case: Case) -> Counter[str]:
        return self.families.setdefault(case.families[0], Counter())
