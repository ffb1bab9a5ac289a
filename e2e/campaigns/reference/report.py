"""The outcomes of `scripts/bench reference` as JSON, as tables, and as the parts of docs/evaluation/reference.md. Pure but for files."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final

from campaigns.reference.catalogue import (
    GENERATIONS,
    SCENARIOS,
    SCHEDULERS,
    THESIS_REPETITIONS,
    THESIS_ROUND_TRIPS,
    Inferred,
)
from campaigns.reference.placement import Placement, find_scenario
from campaigns.reference.trials.trial import Trial
from campaigns.scenarios.contenders import KUBE_SCHEDULER

Json = dict[str, Any]
Rows = list[list[str]]
NOTHING: Final = "-"
APPS: Final = [scenario.app(ros) for scenario in SCENARIOS.values() for ros in GENERATIONS]
UNITS: Final = {"_ms": " ms", "_s": " s", "_m": " m"}
PLACEMENT_HEADS: Final = [
    "application",
    "thesis' plugins",
    "of these decided",
    "scheduler",
    "placements right",
    "nodes",
    "not kept",
]
DECISION_HEADS: Final = ["application", "component", "what refused nodes, and why the chosen one comes before the next"]
TRIAL_HEADS: Final = [
    "application",
    "fault",
    "scheduler",
    "nodes",
    "not where the app asks for",
    "figures of the application",
    "thesis",
    "promise",
]
SHARE_HEADS: Final = [
    "application",
    "placements right under ours",
    "under kube-scheduler",
    "not kept under kube-scheduler",
]
PROFILE_HEADS: Final = ["application", "thesis: inferred", "thesis: expected", "ours: inferred", "ours: expected"]


@dataclass(slots=True)
class Report:
    """Outcomes of runs. A later run replaces those of an earlier one with the same application and scheduler."""

    commands: list[str] = field(default_factory=list)
    machine: dict[str, str] = field(default_factory=dict)
    placements: list[Placement] = field(default_factory=list)
    trials: list[Trial] = field(default_factory=list)
    profiles: dict[str, Inferred] = field(default_factory=dict)

    def note_placement(self, placement: Placement) -> None:
        key = placement.app, placement.scheduler, placement.repetition
        self.placements = [p for p in self.placements if (p.app, p.scheduler, p.repetition) != key] + [placement]

    def note_trial(self, trial: Trial) -> None:
        key = trial.app, trial.scheduler, trial.fault
        self.trials = [t for t in self.trials if (t.app, t.scheduler, t.fault) != key] + [trial]

    def has_placement(self, app: str, scheduler: str, repetition: int) -> bool:
        return any((p.app, p.scheduler, p.repetition) == (app, scheduler, repetition) for p in self.placements)

    def has_trial(self, app: str, scheduler: str, fault: str) -> bool:
        return any((t.app, t.scheduler, t.fault) == (app, scheduler, fault) for t in self.trials)

    def to_json(self) -> Json:
        return {
            "commands": self.commands,
            "machine": self.machine,
            "thesis": {
                "repetitions": THESIS_REPETITIONS,
                "plugins": {
                    scenario.app(ros): scenario.plugins[ros] for scenario in SCENARIOS.values() for ros in GENERATIONS
                },
                "round_trips": [asdict(row) for row in THESIS_ROUND_TRIPS.values()],
                "profiles": {scenario.name: asdict(scenario.thesis_profile) for scenario in SCENARIOS.values()},
            },
            "placements": [asdict(placement) for placement in self.placements],
            "trials": [asdict(trial) for trial in self.trials],
            "profiles": {app: asdict(inferred) for app, inferred in self.profiles.items()},
        }


def read_report(path: Path | None) -> Report:
    """Reads what earlier runs have written; an empty report without a file."""
    if path is None or not path.exists():
        return Report()
    content: Json = json.loads(path.read_text())
    return Report(
        content["commands"],
        content["machine"],
        [Placement(**row) for row in content["placements"]],
        [Trial(**row) for row in content["trials"]],
        {app: Inferred(**row) for app, row in content["profiles"].items()},
    )


def tabulate_placements(placements: Sequence[Placement]) -> Rows:
    """Returns a row per application and scheduler over its repetitions."""
    rows = []
    for app in APPS:
        thesis_plugins = find_scenario(app).plugins[int(app[-1])]
        for contender in SCHEDULERS:
            runs = [p for p in placements if (p.app, p.scheduler) == (app, contender.name)]
            if not runs:
                continue
            deciding_plugins = {plugin for run in runs for plugin in run.plugins}
            broken = dict.fromkeys(promise for run in runs for promise in run.broken)
            rows.append(
                [
                    app,
                    ", ".join(thesis_plugins),
                    ", ".join(plugin for plugin in thesis_plugins if plugin in deciding_plugins) or NOTHING,
                    contender.name,
                    f"{sum(not run.broken for run in runs)}/{len(runs)}",
                    " or ".join(dict.fromkeys(describe_nodes(run.nodes) for run in runs)),
                    "; ".join(broken) or NOTHING,
                ]
            )
    return rows


def tabulate_trials(trials: Sequence[Trial]) -> Rows:
    """Returns a row per application, fault and scheduler."""
    faults = dict.fromkeys(trial.fault for trial in trials)
    trials_in_order = [
        trial
        for app in APPS
        for fault in faults
        for contender in SCHEDULERS
        for trial in trials
        if (trial.app, trial.fault, trial.scheduler) == (app, fault, contender.name)
    ]
    return [
        [
            trial.app,
            trial.fault,
            trial.scheduler,
            describe_nodes(trial.nodes),
            "; ".join(trial.misplaced) or NOTHING,
            ", ".join(describe_figure(name, value) for name, value in trial.figures.items()) or NOTHING,
            quote_thesis(trial.app, trial.scheduler),
            f"not kept: {trial.broken.splitlines()[0].partition(';')[0]}" if trial.broken else "kept",
        ]
        for trial in trials_in_order
    ]


def quote_thesis(app: str, scheduler: str) -> str:
    """Returns the thesis' figures of the application, which it has of teleoperation over DDS alone."""
    if app != "teleop-ros2":
        return NOTHING
    row = THESIS_ROUND_TRIPS[scheduler]
    return f"mean {row.mean_ms} ms, p95 {row.p95_ms} ms, p99 {row.p99_ms} ms in one pod"


def tabulate_shares(placements: Sequence[Placement]) -> Rows:
    """Returns a row per application: how many placements kept all promises of its RobotApp under each scheduler."""
    rows = []
    for app in APPS:
        runs = {c.name: [p for p in placements if (p.app, p.scheduler) == (app, c.name)] for c in SCHEDULERS}
        if any(runs.values()):
            shares = [
                f"{sum(not p.broken for p in placed)}/{len(placed)}" if placed else NOTHING for placed in runs.values()
            ]
            broken = dict.fromkeys(promise for p in runs[KUBE_SCHEDULER.name] for promise in p.broken)
            rows.append([app, *shares, "; ".join(broken) or NOTHING])
    return rows


def tabulate_profiles(profiles: Mapping[str, Inferred]) -> Rows:
    """Returns the thesis' table 4.3 beside ours; the thesis has the five of ROS 2 alone."""
    rows = []
    for app in APPS:
        if app not in profiles:
            continue
        thesis_profile, our_profile = find_scenario(app).thesis_profile, profiles[app]
        thesis = (
            [
                f"{thesis_profile.qos_class}, {thesis_profile.hardware}",
                f"{thesis_profile.expected_class}, {thesis_profile.expected_hardware}",
            ]
            if app.endswith("ros2")
            else [NOTHING, NOTHING]
        )
        rows.append(
            [
                app,
                *thesis,
                f"{our_profile.qos_class}, {our_profile.hardware}",
                f"{our_profile.expected_class}, {our_profile.expected_hardware}",
            ]
        )
    return rows


def describe_nodes(nodes: Mapping[str, str]) -> str:
    return ", ".join(f"{component} on {node or 'no node'}" for component, node in nodes.items()) or NOTHING


def describe_figure(name: str, value: float) -> str:
    """Returns `p50 4.9 ms` for `p50_ms`, and a share in percent."""
    if name.endswith("_share"):
        return f"{name.removesuffix('_share')} {value:.0%}"
    suffix = next((suffix for suffix in UNITS if name.endswith(suffix)), "")
    number = f"{value:.0f}" if value == round(value) else f"{value:.3f}" if abs(value) < 1 else f"{value:.1f}"
    return f"{name.removesuffix(suffix).replace('_', ' ')} {number}{UNITS.get(suffix, '')}"


def list_broken(report: Report) -> list[str]:
    """Returns what was not kept under our scheduler, in sentences."""
    our_scheduler = SCHEDULERS[0].name
    sentences = [
        f"{p.app}, placement {p.repetition}: {'; '.join(p.broken)}"
        for p in report.placements
        if p.scheduler == our_scheduler and p.broken
    ]
    return sentences + [
        f"{t.app}, {t.fault}: {t.broken}" for t in report.trials if t.scheduler == our_scheduler and t.broken
    ]


PLACEMENT_MARKS: Final = "<!-- placement: made by scripts/bench reference --page -->", "<!-- placement: end -->"
TRIAL_MARKS: Final = "<!-- behaviour: made by scripts/bench reference --page -->", "<!-- behaviour: end -->"
SHARE_MARKS: Final = "<!-- applications: made by scripts/bench reference --page -->", "<!-- applications: end -->"
PROFILE_MARKS: Final = "<!-- profiles: made by scripts/bench reference --page -->", "<!-- profiles: end -->"


def write_page(report: Report, page: str) -> str:
    """Returns the page with those of its tables replaced of which the report has outcomes."""
    tables: tuple[tuple[tuple[str, str], list[str], Rows, list[str]], ...] = (
        (PLACEMENT_MARKS, PLACEMENT_HEADS, tabulate_placements(report.placements), _list_decisions(report)),
        (SHARE_MARKS, SHARE_HEADS, tabulate_shares(report.placements), []),
        (TRIAL_MARKS, TRIAL_HEADS, tabulate_trials(report.trials), _list_origin(report)),
        (PROFILE_MARKS, PROFILE_HEADS, tabulate_profiles(report.profiles), []),
    )
    for (begin, end), heads, rows, below in tables:
        if rows and begin in page:
            before, _, rest = page.partition(begin)
            after = rest.partition(end)[2]
            text = "\n".join([*format_table(heads, rows), *below])
            page = f"{before}{begin}\n{text}\n{end}{after}"
    return page


def _list_origin(report: Report) -> list[str]:
    """Returns by which commands the trials were made, and when."""
    days = sorted({trial.began_at[:10] for trial in report.trials} - {""})
    commands = [command for command in report.commands if "--real" in command.split()]
    return ["", f"Made on {', '.join(days)} by", "```", *commands, "```"] if days and commands else []


def append_line(path: Path, trial: Trial) -> None:
    """Appends the outcome of one trial as a line of JSON."""
    with path.open("a") as file:
        file.write(json.dumps(asdict(trial)) + "\n")


def format_table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    lines = [heads, ["---"] * len(heads), *rows]
    return [f"| {' | '.join(cell.replace('|', '/') for cell in cells)} |" for cells in lines]


def _list_decisions(report: Report) -> list[str]:
    """Returns our scheduler's records of the components that had a choice, of each application's first repetition."""
    rows: Rows = []
    for app in APPS:
        our_placements = [
            p for p in report.placements if (p.app, p.scheduler, p.repetition) == (app, SCHEDULERS[0].name, 0)
        ]
        for component, decisions in our_placements[0].decisions.items() if our_placements else ():
            if any(" before " in decision for decision in decisions):
                rows.append([app, component, ". ".join(decisions)])
    return [
        "",
        "What decided, by the scheduler's own records (`explain`), where more than one node was feasible:",
        "",
        *format_table(DECISION_HEADS, rows),
    ]
