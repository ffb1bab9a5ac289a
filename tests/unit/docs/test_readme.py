"""What the README says the demo printed is what the picture of a real run shows."""

import html
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
PICTURE = ROOT / "docs" / "demo.svg"


def like(line: str) -> str:
    """A line without what differs from run to run: numbers (domain, seconds, age) and the room they take."""
    return re.sub(r"\s+", " ", re.sub(r"\d+(\.\d+)?", "N", line)).strip()


def shown() -> set[str]:
    """The lines of the picture, put together from the pieces of one colour they are drawn in."""
    lines: dict[float, str] = {}
    for row, text in re.findall(r'<text[^>]* y="([\d.]+)"[^>]*>([^<]*)</text>', PICTURE.read_text(encoding="utf-8")):
        lines[float(row)] = lines.get(float(row), "") + html.unescape(text).replace("\xa0", " ")
    return {like(line) for line in lines.values()}


def printed() -> list[str]:
    """The lines of the blocks after "What `scripts/demo` printed"."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    section = text.partition("What `scripts/demo` printed")[2].partition("\n## ")[0]
    return [line for block in re.findall(r"```\n(.*?)```", section, re.DOTALL) for line in block.splitlines() if line]


def test_every_line_the_readme_says_the_demo_printed_is_in_the_picture_of_a_real_run() -> None:
    picture = shown()
    assert len(printed()) >= 12
    assert [line for line in printed() if like(line) not in picture] == []


def test_the_picture_cuts_no_line() -> None:
    assert any("it is free when its holder is deleted or suspended" in line for line in shown())
