"""The parts that both imports share: their options, the result and its report."""

import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

from robotapp_api.values.printable import printable
from robotapp_cli.failures import CliError, Exit
from robotapp_cli.importing.report import Line, Verdict
from robotapp_cli.importing.services.draft import Json
from robotapp_cli.importing.writing import format_objects


class ReportForm(StrEnum):
    """Values of --report."""

    TEXT = "text"
    JSON = "json"


@dataclass(frozen=True, slots=True)
class ImportOptions:
    """The command line of `import`."""

    files: Sequence[Path]
    output: Path | None = None
    report: ReportForm = ReportForm.TEXT
    profiles: Sequence[str] = ()
    env: Sequence[str] = ()
    env_files: Sequence[Path] = ()
    images: Sequence[str] = ()
    distro: str = ""
    name: str = ""
    directory: Path | None = None
    workspace: Path | None = None


def check_output(options: ImportOptions) -> None:
    """Refuses an output file that exists. Raises CliError."""
    if options.output is not None and options.output.exists():
        raise CliError(f"{options.output} exists and is not overwritten; give another name", code=Exit.USAGE)


def read_pairs(texts: Iterable[str], option: str, form: str) -> Mapping[str, str]:
    """Returns NAME=VALUE options as pairs. Raises CliError for another form."""
    pairs = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not name:
            raise CliError(f"{option} {text}: write {option} {form}", code=Exit.USAGE)
        pairs[name] = value
    return pairs


def write_objects(objects: list[Json], output: Path | None) -> None:
    """Writes the objects to standard output or a new file. Raises CliError."""
    text = format_objects(objects)
    if output is None:
        sys.stdout.write(text)
        return
    try:
        with output.open("x", encoding="utf-8") as file:
            file.write(text)
    except OSError as error:
        raise CliError(f"{output} cannot be written: {error.strerror}", code=Exit.USAGE) from error


def write_report(lines: Sequence[Line], form: ReportForm) -> None:
    """Writes the report to standard error."""
    if form is ReportForm.JSON:
        data = {"lines": [_describe(line) for line in lines], **_count(lines)}
        sys.stderr.write(json.dumps(data, indent=2) + "\n")
        return
    for line in lines:
        text = f"{line.file}:{line.line}: {line.verdict}: {line.path}: {line.message}"
        sys.stderr.write(printable(text).replace("\n", r"\n") + "\n")
    counts = ", ".join(f"{sum(line.verdict is verdict for line in lines)} {verdict}" for verdict in Verdict)
    sys.stderr.write(f"{counts}. Next: kubectl robotapp lint FILE\n")


def _describe(line: Line) -> dict[str, Any]:
    return {
        "file": line.file,
        "line": line.line,
        "path": line.path,
        "verdict": line.verdict.value,
        "message": line.message,
    }


def _count(lines: Sequence[Line]) -> dict[str, int]:
    names = {Verdict.TAKEN: "taken", Verdict.CHANGED: "changed", Verdict.LEFT_OUT: "leftOut", Verdict.CHOOSE: "choose"}
    return {name: sum(line.verdict is verdict for line in lines) for verdict, name in names.items()}
