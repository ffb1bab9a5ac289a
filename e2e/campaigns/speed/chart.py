"""Bars of pods/s as a small SVG: equal results give equal bytes."""

from collections.abc import Sequence
from xml.sax.saxutils import escape

from campaigns.speed.console import number
from campaigns.speed.contestants import BARE, KUBE_SCHEDULER, OURS
from campaigns.speed.result import Row
from campaigns.speed.verdict import RATE

COLORS = {OURS.name: "#2b7bba", KUBE_SCHEDULER.name: "#c9832b", BARE.name: "#9aa3ab"}
LEFT, WIDTH, BAR, GAP, TOP = 190, 560, 12, 14, 40


def chart(rows: Sequence[Row]) -> str:
    """One group of bars per row, longest bar = highest rate of all."""
    rates = [{name: row.median(name).get(RATE, 0.0) for name in COLORS} for row in rows]
    most = max((value for each in rates for value in each.values()), default=0.0) or 1.0
    height = TOP + len(rows) * (len(COLORS) * BAR + GAP)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {LEFT + WIDTH + 70} {height}" font-family="sans-serif" font-size="11">',
        f'<rect width="100%" height="{height}" fill="#ffffff"/>',
        *_legend(),
    ]
    for index, (row, values) in enumerate(zip(rows, rates, strict=True)):
        top = TOP + index * (len(COLORS) * BAR + GAP)
        parts.append(f'<text x="{LEFT - 8}" y="{top + 22}" text-anchor="end">{escape(row.workload)}</text>')
        for place, (name, value) in enumerate(values.items()):
            parts += _bar(top + place * BAR, value, value / most * WIDTH, COLORS[name])
    return "\n".join([*parts, "</svg>", ""])


def _legend() -> list[str]:
    parts = [f'<text x="{LEFT}" y="24">pods/s</text>']
    for place, (name, color) in enumerate(COLORS.items()):
        x = LEFT + 60 + place * 130
        parts.append(
            f'<rect x="{x}" y="15" width="10" height="10" fill="{color}"/><text x="{x + 15}" y="24">{name}</text>'
        )
    return parts


def _bar(y: int, value: float, length: float, color: str) -> list[str]:
    return [
        f'<rect x="{LEFT}" y="{y}" width="{max(length, 0.5):.1f}" height="{BAR - 1}" fill="{color}"/>',
        f'<text x="{LEFT + length + 4:.1f}" y="{y + 10}" font-size="10">{number(value)}</text>',
    ]
