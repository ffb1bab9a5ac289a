"""Tables for people, JSON and YAML for programs; colour only on a terminal."""

import json
import os
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final

import yaml
from rich.cells import cell_len
from rich.console import Console
from rich.table import Table
from rich.text import Text

from robotapp_api.values.printable import printable

_UNLIMITED: Final = 400
_WORTH_NAMING: Final = 40
"""Characters from which on a repeated text is not printed again."""
_BAR: Final = 12
_GAP: Final = 3
_NARROWEST: Final = 24
"""Columns of text are not folded narrower than this: one word a line is no help."""
_STYLES: Final = {
    **dict.fromkeys(("True", "Running", "yes", "Reserved"), "green"),
    **dict.fromkeys(("False", "Failed", "Degraded", "Offline", "no"), "red"),
    **dict.fromkeys(("Pending", "Placing", "Unknown", "Draining", "Parked", "Stopping", "Suspended"), "yellow"),
}


class Output(StrEnum):
    """Values of -o."""

    TABLE = "table"
    WIDE = "wide"
    JSON = "json"
    YAML = "yaml"

    @property
    def structured(self) -> bool:
        return self in (Output.JSON, Output.YAML)


def console() -> Console:
    """Standard output; where it is no terminal, lines are not cut unless COLUMNS says how wide they may be."""
    width = None if sys.stdout.isatty() or "COLUMNS" in os.environ else _UNLIMITED
    return Console(file=sys.stdout, width=width, highlight=False, soft_wrap=False)


def write_structured(data: Any, output: Output) -> None:
    """Plain JSON or YAML, never coloured or wrapped. What a terminal would obey is escaped, which reads back as the same."""
    if output is Output.JSON:
        text = json.dumps(data, indent=2, ensure_ascii=False)
        shown = (each if each.isprintable() or each == "\n" else json.dumps(each)[1:-1] for each in text)
        sys.stdout.write("".join(shown) + "\n")
        return
    text = _yaml(data, allow_unicode=True)
    plain = text.replace("\n", "").isprintable()
    sys.stdout.write(text if plain else _yaml(data, allow_unicode=False))


def _yaml(data: Any, *, allow_unicode: bool) -> str:
    return str(yaml.safe_dump(data, sort_keys=False, allow_unicode=allow_unicode, width=_UNLIMITED))


@dataclass(frozen=True, slots=True)
class Column:
    """A heading; `wraps` columns give way when the terminal is narrow, down to `narrowest` cells."""

    heading: str
    wraps: bool = False
    narrowest: int = _NARROWEST


def print_table(
    columns: Sequence[Column | str],
    rows: Iterable[Sequence[str]],
    *,
    indent: int = 0,
    gap: int = _GAP,
    on: Console | None = None,
) -> None:
    """Columns without lines, as kubectl prints them: folded to the width there is, but no name is ever cut."""
    table = Table(box=None, pad_edge=False, show_edge=False, header_style="bold", padding=(0, gap, 0, 0))
    specs = [column if isinstance(column, Column) else Column(column) for column in columns]
    lines = [[printable(cell) for cell in row] for row in rows]
    for spec in specs:
        table.add_column(spec.heading, no_wrap=not spec.wraps, overflow="fold" if spec.wraps else "ellipsis")
    for row in lines:
        table.add_row(*(Text(cell, style=_STYLES.get(cell, "")) for cell in row))
    target = on or console()
    target.width = max(target.width - indent, _least_width(specs, lines, gap))
    with target.capture() as capture:
        target.print(table)
    for line in capture.get().splitlines():
        target.file.write(" " * indent + line.rstrip() + "\n")


def print_line(text: str, *, style: str = "") -> None:
    """A sentence as it is, however long. Whatever stands in brackets is text, not Rich's markup."""
    console().print(Text(printable(text), style=style), soft_wrap=True)


def _least_width(specs: Sequence[Column], rows: Sequence[Sequence[str]], gap: int) -> int:
    """Cells a table takes when everything that may be folded is."""
    longest = (max(map(cell_len, cells)) for cells in zip([spec.heading for spec in specs], *rows, strict=True))
    widths = [min(spec.narrowest, width) if spec.wraps else width for spec, width in zip(specs, longest, strict=True)]
    return sum(widths) + gap * len(specs)


def blank_line() -> None:
    sys.stdout.write("\n")


def bar(share: float | None, *, ascii_only: bool | None = None) -> str:
    """A budget's use as a bar of twelve cells; beyond the budget it is full and marked."""
    plain = not _speaks_unicode() if ascii_only is None else ascii_only
    full, empty = ("#", ".") if plain else ("█", "░")
    if share is None:
        return "?" * _BAR
    cells = max(1 if share > 0 else 0, round(min(share, 1.0) * _BAR))
    return full * cells + empty * (_BAR - cells) + ("!" if share > 1 else "")


def arrow() -> str:
    return "→" if _speaks_unicode() else "->"


def _speaks_unicode() -> bool:
    return "utf" in (sys.stdout.encoding or "").lower()


def name_repeated(names: Sequence[str], texts: Sequence[str]) -> list[str]:
    """Returns the texts of a table's rows; a long one that an earlier row has becomes `as NAME`, so that one cause is read once."""
    first: dict[str, str] = {}
    return [
        text if len(text) < _WORTH_NAMING or (of := first.setdefault(text, name)) == name else f"as {of}"
        for name, text in zip(names, texts, strict=True)
    ]
