"""What the page of symptoms quotes is what the programs write, and it has an answer to every reason that means trouble."""

import ast
import re
from functools import cache
from pathlib import Path
from typing import Final

from robotapp_api.model.names import EventReason, PodReason, Reason

ROOT: Final = Path(__file__).resolve().parents[3]
PAGE: Final = (ROOT / "docs/troubleshooting.md").read_text(encoding="utf-8")
SOURCES: Final = ("crds", "client", "claims", "operator", "scheduler", "agent", "cli")
FINE: Final = {
    *(Reason.ACCEPTED, Reason.ALLOCATED, Reason.NOTHING_TO_ALLOCATE, Reason.PLACED, Reason.WAITING_FOR_PODS),
    *(Reason.WITHIN_BUDGET, Reason.ALL_READY, Reason.ROLLING_OUT, Reason.UP_TO_DATE, Reason.NOT_STALLED),
    Reason.COMPLETED,
}
"""Reasons of conditions that need no cure."""
FROM_KUBECTL: Final = {'no matches for kind "RobotApp"', "needs the verb use on robotapps/"}
"""Sentences of kubectl itself, and of the chart's policies."""
GAP: Final = "\0"


@cache
def texts() -> tuple[str, ...]:
    """Every text of the programs; what is filled in is a gap."""
    found = []
    for folder in SOURCES:
        for path in (ROOT / folder).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.JoinedStr):
                    found.append("".join(map(_part, node.values)))
                elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                    found.append(node.value)
    return tuple(found)


def _part(value: ast.expr) -> str:
    return value.value if isinstance(value, ast.Constant) and isinstance(value.value, str) else GAP


def quoted() -> set[str]:
    """The sentences between backquotes in the tables and at the beginning of lines; commands, fields and values are no sentences."""
    codes = [
        code for line in PAGE.splitlines() if line.startswith(("|", "`")) for code in re.findall(r"`([^`]+)`", line)
    ]
    return {
        code
        for code in codes
        if " " in code
        and not re.match(r"(kubectl|ros2|robotapp-agent|[\w.]+: [A-Za-z{]+[^ ]*$|securityContext|latency: )", code)
    }


def is_written(sentence: str) -> bool:
    """Does one text have all the words between the gaps, in this order? `…` is what is filled in, or left out here."""
    words = [re.escape(part.strip()) for part in sentence.split("…") if part.strip(" ;:,")]
    pattern = re.compile(".*".join(words), re.DOTALL)
    return any(pattern.search(text) for text in texts())


def test_every_sentence_that_is_quoted_is_one_of_the_programs() -> None:
    assert len(quoted()) >= 45
    assert sorted(each for each in quoted() - FROM_KUBECTL if not is_written(each)) == []


def test_every_reason_that_means_trouble_is_on_the_page() -> None:
    reasons = {*Reason, *PodReason} - FINE
    assert sorted(reason for reason in reasons if f"`{reason}`" not in PAGE) == []


def test_every_event_is_explained() -> None:
    events = PAGE.partition("## What an event means")[2]
    assert sorted(reason for reason in EventReason if f"`{reason}`" not in events) == []


def test_every_word_that_looks_like_a_reason_is_one() -> None:
    known = {*map(str, Reason), *map(str, EventReason), *map(str, PodReason)}
    named = set(re.findall(r"\| `([A-Z][a-z]+(?:[A-Z][a-z]+)+)`", PAGE))
    kinds = {"BudgetMet"}
    assert named - kinds <= known
