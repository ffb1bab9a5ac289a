"""Makes the comparisons, tables and notes that docs/evaluation/eo2-protocol.md announces. Pure."""

from collections import defaultdict
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from campaigns.teleop.design import ARMS, BUDGET_MS, OPERATOR_NODES, Arm, Condition, plan_turns
from campaigns.teleop.intervals import PRIMARY, Interval, Statistic, compute_interval, judge
from campaigns.teleop.metrics import Figures
from campaigns.teleop.records import Deployment, Results

BUSY: Final = 0.9
"""Blocks with a window in which the machine was busier than this are left out of the sensitivity analysis."""
NOT_MISSED_MORE: Final = 0.02
NOT_LATER_S: Final = 1.0
ALL: Final = "all conditions"
ELSEWHERE: Final = "elsewhere or none"
Block = Mapping[Arm, Deployment]


@dataclass(frozen=True, slots=True)
class Metric:
    """A figure of a deployment, how deployments are summed up, and how a value and a difference are written."""

    name: str
    read: Callable[[Figures], float]
    statistic: Statistic
    write: Callable[[float], str]
    write_difference: Callable[[float], str]


def _write_percent(value: float) -> str:
    return f"{100 * value:.1f} %"


def _write_points(value: float) -> str:
    return f"{100 * value:+.1f} points"


def _write_ms(value: float) -> str:
    return f"{value:.1f} ms"


def _write_seconds(value: float) -> str:
    return f"{value:.2f} s"


def _write_more_ms(value: float) -> str:
    return f"{value:+.1f} ms"


def _write_more_seconds(value: float) -> str:
    return f"{value:+.2f} s"


MISSED: Final = Metric("missed deadlines", lambda figures: figures.missed_share, np.mean, _write_percent, _write_points)
P95: Final = Metric("p95", lambda figures: figures.p95_ms, np.median, _write_ms, _write_more_ms)
FIRST_TRIP: Final = Metric(
    "first trip", lambda figures: figures.first_trip_s, np.median, _write_seconds, _write_more_seconds
)
METRICS: Final = (
    Metric("p50", lambda figures: figures.p50_ms, np.median, _write_ms, _write_more_ms),
    P95,
    Metric("p99", lambda figures: figures.p99_ms, np.median, _write_ms, _write_more_ms),
    MISSED,
    FIRST_TRIP,
)


@dataclass(frozen=True, slots=True)
class Comparison:
    """Difference of ours and another arm, within blocks."""

    hypothesis: str
    ros: int
    text: str
    metric: Metric
    blocks: int
    difference: Interval
    verdict: str

    def to_cells(self) -> list[str]:
        values = (self.difference.value, self.difference.low, self.difference.high)
        value, low, high = (self.metric.write_difference(value) for value in values)
        return [
            self.hypothesis,
            f"ROS {self.ros}",
            self.text,
            str(self.blocks),
            f"{value} ({low} to {high})",
            f"**{self.verdict}**",
        ]


def list_blocks(deployments: Iterable[Deployment]) -> list[Block]:
    """Returns the blocks in which every arm has a valid deployment."""
    by_block: dict[int, dict[Arm, Deployment]] = defaultdict(dict)
    for deployment in deployments:
        if not deployment.void and deployment.figures is not None:
            by_block[deployment.turn.block][deployment.turn.arm] = deployment
    return [block for _, block in sorted(by_block.items()) if len(block) == len(ARMS)]


def read_condition(block: Block) -> Condition:
    return block[Arm.OURS].turn.condition


def keeps_budget(deployment: Deployment) -> bool:
    """Returns whether the operator side has a node, within the budget of its robot."""
    return bool(deployment.node) and deployment.turn.condition.keeps_budget(deployment.node)


def was_busy(deployment: Deployment) -> bool:
    """Returns whether the machine was too busy in the window; a deployment without a round trip has none and stays."""
    return deployment.load is not None and deployment.load.busy_share > BUSY


def compare(blocks: Sequence[Block], metric: Metric, other: Arm, *, level: float = 0.95) -> Interval:
    """Returns the interval of ours less the other arm; negative means that ours has less."""
    strata: dict[Hashable, list[float]] = defaultdict(list)
    for block in blocks:
        strata[read_condition(block)].append(_read(block[Arm.OURS], metric) - _read(block[other], metric))
    return compute_interval(strata, metric.statistic, level=level)


def examine_hypotheses(blocks: Sequence[Block], ros: int) -> Iterator[Comparison]:
    """Yields H1 to H4 of one ROS generation, as far as there are blocks for them."""
    generation = [block for block in blocks if read_condition(block).ros == ros]
    for hypothesis, other in (("H1", Arm.KUBE_SCHEDULER), ("H2", Arm.AFFINITY)):
        if generation:
            difference = compare(generation, MISSED, other, level=PRIMARY)
            text = f"missed deadlines, ours less {other}"
            yield Comparison(hypothesis, ros, text, MISSED, len(generation), difference, judge(difference))
    calm_blocks = [block for block in generation if read_condition(block).disturbance == "undisturbed"]
    for hypothesis, chosen, metric, other, margin in (
        ("H3", calm_blocks, MISSED, Arm.AFFINITY, NOT_MISSED_MORE),
        ("H4", generation, FIRST_TRIP, Arm.KUBE_SCHEDULER, NOT_LATER_S),
    ):
        if chosen:
            difference = compare(chosen, metric, other)
            verdict = "holds" if difference.high < margin else "not shown"
            place = ", undisturbed" if chosen is calm_blocks else ""
            text = f"{metric.name}{place}, ours less {other}: below {metric.write_difference(margin)}"
            yield Comparison(hypothesis, ros, text, metric, len(chosen), difference, verdict)


def report(results: Results) -> list[str]:
    """Returns the whole report as lines of Markdown."""
    blocks = list_blocks(results.deployments)
    valid = results.valid
    return [
        *_describe_state(results, blocks),
        "",
        *_make_table(
            ["", "generation", "difference", "blocks", "value (interval)", "verdict"],
            [comparison.to_cells() for ros in (2, 1) for comparison in examine_hypotheses(blocks, ros)]
            + [_check_budgets(valid)],
        ),
        *_describe_sensitivity(blocks),
        "",
        *_make_table(
            ["generation", "condition", "arm", "deployments", *(metric.name for metric in METRICS)],
            list(_list_figures(valid)),
        ),
        "",
        *_make_table(
            ["generation", "condition", "arm", *OPERATOR_NODES, ELSEWHERE, f"within {BUDGET_MS:g} ms"],
            list(_list_placements(valid)),
        ),
    ]


def _describe_state(results: Results, blocks: Sequence[Block]) -> list[str]:
    turn_count = len(plan_turns(results.header.seed, results.header.rounds))
    done = len(results.valid)
    void = [deployment.void for deployment in results.deployments if deployment.void]
    lines = ["PILOT: these deployments count for nothing."] if results.header.pilot else []
    lines += [f"UNFINISHED: {done} of {turn_count} deployments."] if done < turn_count else []
    reasons = f": {'; '.join(dict.fromkeys(void))}" if void else ""
    lines.append(
        f"{done} deployments, {len(blocks)} complete blocks, seed {results.header.seed}, {len(results.sessions)} sessions;"
        f" {len(void)} void{reasons}."
    )
    if any(session.loaded for session in results.sessions):
        lines.append("LOADED: at least one session began while others used the machine.")
    return lines


def _check_budgets(deployments: Sequence[Deployment]) -> list[str]:
    placements = [deployment for deployment in deployments if deployment.turn.arm is Arm.OURS and deployment.node]
    beyond = sum(not keeps_budget(deployment) for deployment in placements)
    verdict = "holds" if placements and not beyond else "contradicted" if beyond else "not shown"
    return [
        "H5",
        "both",
        "placements of ours beyond the budget",
        "",
        f"{beyond} of {len(placements)}",
        f"**{verdict}**",
    ]


def _describe_sensitivity(blocks: Sequence[Block]) -> list[str]:
    calm = [block for block in blocks if not any(was_busy(deployment) for deployment in block.values())]
    comparisons = [comparison for ros in (2, 1) for comparison in examine_hypotheses(calm, ros)]
    rows = [comparison.to_cells() for comparison in comparisons if comparison.hypothesis in ("H1", "H2")]
    return [
        "",
        f"Without blocks in which more than {BUSY:.0%} of the machine's CPU time was busy ({len(blocks) - len(calm)}):",
        "",
        *_make_table(["", "generation", "difference", "blocks", "value (interval)", "verdict"], rows),
    ]


def _list_figures(deployments: Sequence[Deployment]) -> Iterator[list[str]]:
    for ros, name, arm, chosen in _yield_groups(deployments):
        strata: dict[Hashable, list[Deployment]] = defaultdict(list)
        for deployment in chosen:
            strata[deployment.turn.condition].append(deployment)
        cells = []
        for metric in METRICS:
            values = {key: [_read(deployment, metric) for deployment in group] for key, group in strata.items()}
            interval = compute_interval(values, metric.statistic)
            value, low, high = (metric.write(end) for end in (interval.value, interval.low, interval.high))
            cells.append(f"{value} ({low.split(' ')[0]} to {high.split(' ')[0]})")
        yield [f"ROS {ros}", name, arm, str(len(chosen)), *cells]


def _list_placements(deployments: Sequence[Deployment]) -> Iterator[list[str]]:
    for ros, name, arm, chosen in _yield_groups(deployments):
        nodes = [deployment.node for deployment in chosen]
        counts = [nodes.count(node) for node in OPERATOR_NODES]
        within = sum(keeps_budget(deployment) for deployment in chosen)
        cells = [str(count) for count in (*counts, len(chosen) - sum(counts))]
        yield [f"ROS {ros}", name, arm, *cells, f"{within} of {len(chosen)}"]


def _yield_groups(deployments: Sequence[Deployment]) -> Iterator[tuple[int, str, Arm, list[Deployment]]]:
    """Yields generation, condition, arm and their deployments; all conditions together first."""
    for ros in (2, 1):
        generation = [
            deployment for deployment in deployments if deployment.turn.condition.ros == ros and deployment.figures
        ]
        conditions = sorted({deployment.turn.condition for deployment in generation})
        for name in (ALL, *(condition.disturbance for condition in conditions)):
            group = [deployment for deployment in generation if name in (ALL, deployment.turn.condition.disturbance)]
            for arm in ARMS:
                if deployments_of_arm := [deployment for deployment in group if deployment.turn.arm is arm]:
                    yield ros, name, arm, deployments_of_arm


def _read(deployment: Deployment, metric: Metric) -> float:
    if deployment.figures is None:
        raise ValueError(f"deployment {deployment.turn.number} has no figures")
    return metric.read(deployment.figures)


def _make_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    return [_make_row(header), _make_row(["---"] * len(header)), *(_make_row(row) for row in rows)]


def _make_row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"
