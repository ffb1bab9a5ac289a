"""The thesis' scenarios on random clusters, under our scheduler and kube-scheduler in one control plane.

Each repetition draws a cluster of 3 to --most-nodes nodes with zones, hardware and load, and plays all scenarios in random
order, each under both schedulers with the same draw. Nodes and kubelets are simulated; the control plane, both schedulers and
our operator are real. `--first N --repetitions 1` with the same seed gives repetition N again.
"""

import argparse
import json
import os
import platform
import random
import re
import shlex
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

from rich.console import Console
from rich.table import Table

from campaigns.common import options
from campaigns.common.figures import percentile
from campaigns.rigs.stage import container
from campaigns.scenarios.catalogue import SCENARIOS, Scenario
from campaigns.scenarios.cluster import Cluster, Json, draw
from campaigns.scenarios.contenders import KUBE_SCHEDULER, OURS, Contender, Running, started
from campaigns.scenarios.promises import refused_bindings
from campaigns.scenarios.promises.place import Place, Verdict
from campaigns.scenarios.watch import ClusterWatch
from campaigns.speed.page import replaced
from robotapp_client.api.resources import DOMAINPOOLS, PODS
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane import product
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.machines.topology import apply, remove

POOL: Final = DOMAINPOOLS.path(None, "default")
NOT_OVER: Final = "it did not come to an end: "


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one scenario under one scheduler. `repetition` and the campaign's seed give it again."""

    repetition: int
    nodes: int
    scenario: str
    contender: str
    verdict: Verdict
    seconds: float


class Campaign:
    """Scenarios on a control plane with our chart installed. `most_nodes` bounds the clusters."""

    def __init__(self, cp: ControlPlane, scenarios: Sequence[Scenario], *, seed: int, most_nodes: int) -> None:
        self._cp = cp
        self._scenarios = scenarios
        self._seed = seed
        self._most_nodes = most_nodes

    def run(self, repetitions: Iterable[int], note: Callable[[Outcome], None]) -> None:
        """Play these repetitions; each outcome is noted as soon as it is there."""
        with ExitStack() as stack:
            stack.enter_context(_short_rest(self._cp))
            stack.enter_context(refused_bindings.policy(self._cp))
            watch = stack.enter_context(ClusterWatch(self._cp.kubeconfig()))
            schedulers = stack.enter_context(started(self._cp))
            operator = product.start_operator(
                self._cp, name="operator-scenarios", sweep_seconds=1, no_leader_election=True
            )
            stack.callback(operator.stop)
            for repetition in repetitions:
                self._repetition(repetition, watch, schedulers, note)

    def _repetition(
        self, repetition: int, watch: ClusterWatch, schedulers: Sequence[Running], note: Callable[[Outcome], None]
    ) -> None:
        rng = random.Random(f"{self._seed}/{repetition}")
        cluster = draw(rng, most_nodes=self._most_nodes, mark=f"scenario-{repetition}")
        order = rng.sample(self._scenarios, len(self._scenarios))
        with _built(self._cp, cluster, f"scenarios-{repetition}") as namespace:
            for scenario in order:
                for running in rng.sample(schedulers, len(schedulers)):
                    if running.contender in scenario.under:
                        place = Place(
                            self._cp,
                            watch,
                            cluster,
                            running=running,
                            namespace=namespace,
                            prefix=f"{scenario.name}-{running.contender.name[0]}",
                            rng=random.Random(f"{self._seed}/{repetition}/{scenario.name}"),
                        )
                        began_s = time.monotonic()
                        verdict = _played(scenario, place)
                        took_s = time.monotonic() - began_s
                        where = repetition, len(cluster.nodes), scenario.name, running.contender.name
                        note(Outcome(*where, verdict=verdict, seconds=took_s))


def _played(scenario: Scenario, place: Place) -> Verdict:
    """The verdict; what does not come to an end keeps none of its promises."""
    try:
        place.until_known()
        return scenario.run(place)
    except TimeoutError as late:
        return Verdict(0, 1, f"{NOT_OVER}{late}")
    finally:
        place.clear()


@contextmanager
def _built(cp: ControlPlane, cluster: Cluster, name: str) -> Iterator[str]:
    """Nodes with their load, and a namespace for the scenarios, whose name is yielded."""
    with ExitStack() as stack:
        stack.callback(remove, cp, cluster.nodes)
        apply(cp, cluster.nodes)
        load = stack.enter_context(created(cp, f"{name}-load"))
        stack.callback(cp.api.delete, f"{PODS.path(load)}?gracePeriodSeconds=0")
        cp.api.each(lambda body: cp.api.create(PODS.path(load), body), _load_pods(cluster))
        yield stack.enter_context(created(cp, name))


def _load_pods(cluster: Cluster) -> list[Json]:
    """A pod on each node that requests the node's load."""
    return [
        {
            "metadata": {"name": f"load-{node}"},
            "spec": {
                "nodeName": node,
                "terminationGracePeriodSeconds": 0,
                "containers": [container(room.requests)],
                "tolerations": [{"operator": "Exists"}],
            },
        }
        for node, room in cluster.load.items()
    ]


@contextmanager
def _short_rest(cp: ControlPlane) -> Iterator[None]:
    """Domains of the default pool rest for one second instead of the shipped sixty."""
    before = cp.api.get(POOL)["spec"].get("quarantineSeconds")
    cp.api.patch(POOL, {"spec": {"quarantineSeconds": 1}})
    try:
        yield
    finally:
        cp.api.patch(POOL, {"spec": {"quarantineSeconds": before}})


HEADS: Final = (
    "scenario", "thesis", "what is counted", "robotapp: runs", "robotapp: counted", "kube-scheduler: runs",
    "kube-scheduler: counted",
)  # fmt: skip
TEXTS: Final = frozenset(HEADS[:3])
HANDOVER: Final = "handover_ms"
NOTHING: Final = "-"


@dataclass(slots=True)
class Report:
    """What was run, and what came of it."""

    command: str
    options: Mapping[str, Any]
    machine: Mapping[str, str]
    outcomes: list[Outcome] = field(default_factory=list)

    @property
    def missed(self) -> list[Outcome]:
        """Runs under our scheduler that did not keep every promise."""
        return [each for each in self.outcomes if each.contender == OURS.name and not each.verdict.met]

    def write(self, path: Path) -> None:
        found = [asdict(each) for each in self.outcomes]
        head = {"command": self.command, "options": dict(self.options), "machine": dict(self.machine)}
        path.write_text(json.dumps({**head, "outcomes": found}, indent=2) + "\n")

    def of(self, scenario: Scenario, contender: Contender) -> list[Outcome]:
        return [each for each in self.outcomes if (each.scenario, each.contender) == (scenario.name, contender.name)]

    def played(self) -> list[Scenario]:
        """Scenarios with an outcome, in the order of the catalogue."""
        return [each for each in SCENARIOS.values() if self.of(each, OURS)]


def line(outcome: Outcome) -> str:
    """One run, as it is told while the campaign goes on."""
    verdict = outcome.verdict
    word = "kept  " if verdict.met else "MISSED" if outcome.contender == OURS.name else "other "
    kept = f"{verdict.kept}/{verdict.of}"
    where = f"{outcome.repetition:4} {outcome.nodes:4} nodes  {outcome.contender:15}{outcome.scenario:14}"
    return f"{word} {where}{kept:>8}{outcome.seconds:7.1f} s  {verdict.reason}".rstrip()


def table(report: Report) -> Table:
    made = Table(title="the thesis' scenarios, runs in which every promise was kept")
    for head in HEADS:
        made.add_column(head, justify="left" if head in TEXTS else "right")
    for scenario in report.played():
        made.add_row(*_cells(report, scenario))
    return made


def section(report: Report) -> str:
    """The part of docs/evaluation/eo1.md between its marks."""
    sizes = sorted(each.nodes for each in report.outcomes)
    options = report.options
    where = f"{sizes[0]} to {sizes[-1]} nodes (median {percentile(sizes, 50):.0f}), {report.machine['cores']} cores for everything"
    lines = [
        f"{options['repetitions']} repetitions, seed {options['seed']}, {where}. Made by",
        "```",
        report.command,
        "```",
        "",
    ]
    lines += [_row(HEADS), _row(["---"] * len(HEADS))]
    lines += [_row(_cells(report, scenario)) for scenario in report.played()]
    return "\n".join([*lines, "", *_handovers(report), *_misses(report)]).rstrip()


def _cells(report: Report, scenario: Scenario) -> list[str]:
    cells = [scenario.text, scenario.section, scenario.counted]
    for contender in (OURS, KUBE_SCHEDULER):
        found = report.of(scenario, contender)
        met = sum(each.verdict.met for each in found)
        kept, of = sum(each.verdict.kept for each in found), sum(each.verdict.of for each in found)
        cells += [f"{met}/{len(found)}", f"{kept}/{of}"] if found else [NOTHING, NOTHING]
    return cells


def _handovers(report: Report) -> Iterable[str]:
    """How long it took until the next holder of a device ran."""
    for scenario in report.played():
        taken_ms = [
            each.verdict.figures[HANDOVER] for each in report.of(scenario, OURS) if HANDOVER in each.verdict.figures
        ]
        if taken_ms:
            p50, most = percentile(taken_ms, 50), max(taken_ms)
            yield f"- {scenario.name}: the second runs {p50:.0f} ms after the first was deleted (median), {most:.0f} ms at most"


def _misses(report: Report) -> Iterable[str]:
    for each in report.missed:
        yield f"- missed: {each.scenario}, repetition {each.repetition}, {each.nodes} nodes: {each.verdict.reason}"


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


BEGIN, END = "<!-- scenarios: made by scripts/bench scenarios --page -->", "<!-- scenarios: end -->"
WIDTH = 180


def main(argv: Sequence[str] | None = None) -> int:
    parser = _parser()
    arguments = parser.parse_args(argv)
    chosen = [each for each in SCENARIOS.values() if re.search(arguments.only, each.name)]
    if not chosen:
        parser.error(f"no scenario is called so; there are: {', '.join(SCENARIOS)}")
    given = {"repetitions": arguments.repetitions, "first": arguments.first, "seed": arguments.seed,
             "most_nodes": arguments.most_nodes, "only": arguments.only}  # fmt: skip
    machine = {"python": platform.python_version(), "machine": platform.machine(), "cores": str(os.cpu_count())}
    report = Report(_command(sys.argv[1:] if argv is None else argv), given, machine)

    def note(outcome: Outcome) -> None:
        report.outcomes.append(outcome)
        print(line(outcome), file=sys.stderr, flush=True)

    with ControlPlane() as cp:
        product.install(cp)
        try:
            campaign = Campaign(cp, chosen, seed=arguments.seed, most_nodes=arguments.most_nodes)
            campaign.run(range(arguments.first, arguments.first + arguments.repetitions), note)
        finally:
            if arguments.json:
                report.write(arguments.json)
    Console(width=WIDTH).print(table(report))
    if arguments.page:
        arguments.page.write_text(replaced(arguments.page.read_text(), section(report), begin=BEGIN, end=END))
    return 1 if report.missed else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="scripts/bench scenarios", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.epilog = "scenarios:\n" + "\n".join(f"  {each.name:16}{each.text}" for each in SCENARIOS.values())
    parser.add_argument("--repetitions", type=options.count(1), default=5)
    parser.add_argument("--first", type=options.count(0), default=0, metavar="N", help="number of the first repetition")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--most-nodes", type=options.count(3, 1000), default=200)
    parser.add_argument("--only", default="", help="scenarios whose name this regular expression finds")
    parser.add_argument("--json", type=options.report, help="write every outcome to this file")
    parser.add_argument(
        "--page", type=Path, help="write the table between the marks of this page: docs/evaluation/eo1.md"
    )
    return parser


def _command(given: Sequence[str]) -> str:
    """How to run the same again; where the files went is left out."""
    files = {"--json", "--page"}
    kept = [word for before, word in pairwise(["", *given]) if not {before, word} & files]
    return shlex.join(["scripts/bench", "scenarios", *kept])


if __name__ == "__main__":
    sys.exit(main())
