"""Chooses the runs of a comparison of the reference applications, and their order in a turn. Pure but for the clock."""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from campaigns.reference.catalogue import OUTAGES_S, SCHEDULERS, Fault, Scenario
from campaigns.scenarios.contenders import Contender

OWN: Final = "own"
ALL: Final = "all"


@dataclass(frozen=True, slots=True)
class Turn:
    """One run of one application under one scheduler: a placement, or with a fault a trial on real nodes."""

    scenario: Scenario
    ros: int
    contender: Contender
    repetition: int = 0
    fault: Fault | None = None

    @property
    def app(self) -> str:
        return self.scenario.app(self.ros)

    @property
    def fault_text(self) -> str:
        """The fault as the report has it, "" without one."""
        return self.scenario.describe_fault(self.fault, OUTAGES_S.get(self.fault, 0.0)) if self.fault else ""


def plan_placements(
    scenarios: Sequence[Scenario], generations: Sequence[int], contenders: Sequence[Contender], repetitions: int
) -> list[Turn]:
    """Returns placements of each application under the schedulers in turn, every other repetition in the other order."""
    return [
        Turn(scenario, ros, contender, repetition)
        for repetition in range(repetitions)
        for scenario in scenarios
        for ros in generations
        for contender in (contenders if repetition % 2 == 0 else contenders[::-1])
    ]


def plan_trials(
    scenarios: Sequence[Scenario], generations: Sequence[int], contenders: Sequence[Contender], faults: str
) -> list[Turn]:
    """Returns trials of each application: through its own fault, through all of which its README promises something, or through one."""
    return [
        Turn(scenario, ros, contender, fault=fault)
        for scenario in scenarios
        for ros in generations
        for fault in choose_faults(scenario, ros, faults)
        for contender in contenders
    ]


def choose_faults(scenario: Scenario, ros: int, faults: str) -> Sequence[Fault]:
    """Returns the faults of an application by what `--fault` says: `own`, `all`, or the name of one, which not every one has."""
    if faults == OWN:
        return scenario.faults[:1]
    return [fault for fault in scenario.list_faults(ros) if faults in (ALL, fault)]


def choose_contenders(scheduler: str) -> Sequence[Contender]:
    """Returns the schedulers by what `--scheduler` says."""
    return [contender for contender in SCHEDULERS if scheduler in (ALL, contender.name)]


def put_missing_first(turns: Sequence[Turn], has_outcome: Callable[[Turn], bool]) -> list[Turn]:
    """Returns the runs that an earlier turn has made after those that it has not."""
    return sorted(turns, key=has_outcome)


def within(turns: Sequence[Turn], minutes: float, clock: Callable[[], float] = time.monotonic) -> Iterator[Turn]:
    """Yields runs until the minutes are over: no run is begun later, one that has begun is ended."""
    until_s = clock() + 60 * minutes
    for turn in turns:
        if clock() >= until_s:
            return
        yield turn
