"""Box plots of the deployments as SVG, written plainly. Pure."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from typing import Final

import numpy as np

from campaigns.teleop.analysis import FIRST_TRIP, MISSED, P95, Metric
from campaigns.teleop.design import ARMS, Arm
from campaigns.teleop.metrics import LOST_MS, NO_TRIP_S
from campaigns.teleop.records import Deployment, Results

COLORS: Final = {Arm.KUBE_SCHEDULER: "#c9832b", Arm.AFFINITY: "#6f7d88", Arm.OURS: "#2b7bba"}
PANEL_WIDTH, PANEL_HEIGHT = 270, 220
LEFT, TOP, BOTTOM, GAP = 52, 34, 26, 34
WHISKER: Final = 1.5
"""Whiskers reach to the farthest value within so many interquartile ranges of the box (Tukey)."""
BOX_WIDTH: Final = 44
DOT_SPREAD: Final = 30


@dataclass(frozen=True, slots=True)
class Box:
    """Quartiles and whiskers of some values."""

    low: float
    first: float
    median: float
    third: float
    high: float


@dataclass(frozen=True, slots=True)
class Axis:
    """A vertical axis with its ticks; `place` returns the share of the height, 0 at the bottom."""

    title: str
    metric: Metric
    ticks: Sequence[float]
    label: Callable[[float], str]
    place: Callable[[float], float]


def summarise_box(values: Sequence[float]) -> Box:
    first, median, third = (float(value) for value in np.quantile(values, [0.25, 0.5, 0.75]))
    reach = WHISKER * (third - first)
    # A quartile lies between two values, so that the farthest value within reach may be inside of the box.
    low = min(first, *(value for value in values if value >= first - reach))
    high = max(third, *(value for value in values if value <= third + reach))
    return Box(low, first, median, third, high)


def _place_logarithmic(low: float, high: float) -> Callable[[float], float]:
    return lambda value: math.log(min(max(value, low), high) / low) / math.log(high / low)


def _place_linear(high: float) -> Callable[[float], float]:
    return lambda value: min(max(value, 0.0), high) / high


AXES: Final = (
    Axis(
        "p95 of the round trip, ms", P95, (1, 3, 10, 30, 100, 300, 1000), "{:g}".format, _place_logarithmic(1, LOST_MS)
    ),
    Axis("missed deadlines, %", MISSED, (0, 0.25, 0.5, 0.75, 1), lambda value: f"{100 * value:g}", _place_linear(1)),
    Axis("time to first trip, s", FIRST_TRIP, (1, 2, 5, 10, 20, 45), "{:g}".format, _place_logarithmic(1, NO_TRIP_S)),
)


def draw(results: Results) -> str:
    """Returns a picture with a panel for each ROS generation and metric, and a box for each arm."""
    width = len(AXES) * (PANEL_WIDTH + GAP) + GAP
    row_height = TOP + PANEL_HEIGHT + BOTTOM
    height = 2 * row_height + 24
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-family="sans-serif" font-size="11">',
        f'<rect width="{width}" height="{height}" fill="#ffffff"/>',
    ]
    if results.header.pilot:
        parts.append(
            f'<text x="{width / 2:g}" y="14" text-anchor="middle" fill="#b00020">pilot: counts for nothing</text>'
        )
    for row, ros in enumerate((2, 1)):
        deployments = [
            deployment for deployment in results.valid if deployment.turn.condition.ros == ros and deployment.figures
        ]
        for column, axis in enumerate(AXES):
            x, y = GAP + column * (PANEL_WIDTH + GAP), row * row_height + TOP + 10
            parts += [f'<g transform="translate({x} {y})">', *_draw_panel(axis, ros, deployments), "</g>"]
    note = "box: quartiles; whiskers: farthest value within 1.5 interquartile ranges; a dot per deployment, filled with ballast or a worse link"
    parts.append(f'<text x="{GAP}" y="{height - 8}" font-size="10" fill="#555555">{escape(note)}</text>')
    return "\n".join([*parts, "</svg>", ""])


def _draw_panel(axis: Axis, ros: int, deployments: Sequence[Deployment]) -> list[str]:
    parts = [f'<text x="{LEFT}" y="-8" font-weight="bold">ROS {ros}: {escape(axis.title)}</text>']
    for tick in axis.ticks:
        y = _find_y(axis, tick)
        parts.append(f'<line x1="{LEFT}" x2="{PANEL_WIDTH}" y1="{y:.1f}" y2="{y:.1f}" stroke="#e3e6e8"/>')
        parts.append(f'<text x="{LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{escape(axis.label(tick))}</text>')
    for place, arm in enumerate(ARMS):
        center = LEFT + (PANEL_WIDTH - LEFT) * (place + 0.5) / len(ARMS)
        deployments_of_arm = [deployment for deployment in deployments if deployment.turn.arm is arm]
        parts.append(f'<text x="{center:.1f}" y="{PANEL_HEIGHT + 16}" text-anchor="middle">{escape(arm)}</text>')
        if deployments_of_arm:
            parts += _draw_box(axis, arm, deployments_of_arm, center)
    return parts


def _draw_box(axis: Axis, arm: Arm, deployments: Sequence[Deployment], center: float) -> list[str]:
    values = [axis.metric.read(deployment.figures) for deployment in deployments if deployment.figures]
    box, color, half = summarise_box(values), COLORS[arm], BOX_WIDTH / 2
    low, first, median, third, high = (
        _find_y(axis, value) for value in (box.low, box.first, box.median, box.third, box.high)
    )
    ends = f'x1="{center - half:.1f}" x2="{center + half:.1f}"'
    size = f'width="{BOX_WIDTH}" height="{max(first - third, 0.5):.1f}"'
    parts = [
        f'<line x1="{center:.1f}" x2="{center:.1f}" y1="{low:.1f}" y2="{high:.1f}" stroke="{color}"/>',
        f'<rect x="{center - half:.1f}" y="{third:.1f}" {size} fill="{color}" fill-opacity="0.25" stroke="{color}"/>',
        f'<line {ends} y1="{median:.1f}" y2="{median:.1f}" stroke="{color}" stroke-width="2"/>',
    ]
    for number, (deployment, value) in enumerate(zip(deployments, values, strict=True)):
        # Spread evenly by the golden ratio, so that neighbours do not hide each other and the picture is the same each time.
        x = center + DOT_SPREAD * ((number * 0.618034) % 1 - 0.5)
        is_disturbed = deployment.turn.condition.disturbance != "undisturbed"
        fill = color if is_disturbed else "#ffffff"
        parts.append(
            f'<circle cx="{x:.1f}" cy="{_find_y(axis, value):.1f}" r="2" fill="{fill}" stroke="{color}" stroke-width="0.7"/>'
        )
    return parts


def _find_y(axis: Axis, value: float) -> float:
    return PANEL_HEIGHT * (1 - axis.place(value))
