"""`lint`: read files, check them, print what is wrong. Nothing here needs a cluster or a kubeconfig."""

import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from robotapp_api.model.names import API_VERSION
from robotapp_api.values.printable import printable
from robotapp_cli.failures import CliError, Exit
from robotapp_cli.lint.definitions import KINDS
from robotapp_cli.lint.findings import Located, Place, Severity, Why
from robotapp_cli.lint.linter import Report, lint
from robotapp_cli.lint.reading import MOST_TEXT
from robotapp_cli.output import Output, write_structured
from robotapp_cli.reading.files import content

_SUFFIXES: Final = (".json", ".yaml", ".yml")
_LONGEST: Final = 2000
"""Characters of a message: parts of the file stand in some."""


@dataclass(frozen=True, slots=True)
class Checked:
    """One file with what was found in it."""

    name: str
    report: Report


def show_lint(files: Sequence[Path], output: Output) -> Exit:
    """Print the findings of all files. Raises CliError for a file that cannot be read."""
    if not files:
        raise CliError("give a FILE with a RobotApp, a folder of such files, or - for standard input", code=Exit.USAGE)
    checked = [Checked(str(path), lint(content(path, most_bytes=MOST_TEXT))) for path in _list_files(files)]
    _refuse_nothing(checked)
    if output.structured:
        write_structured(_structured(checked), output)
    else:
        lines = [line(each.name, found) for each in checked for found in each.report.findings]
        _write([*lines, _totals(checked)])
    return Exit.REFUSED if _count(checked)[Severity.ERROR] else Exit.OK


def _list_files(paths: Sequence[Path]) -> Iterator[Path]:
    """Yields the files, and of a folder those that `kubectl apply -f FOLDER` takes."""
    for path in paths:
        if not path.is_dir():
            yield path
            continue
        try:
            names = sorted(path.iterdir())
        except OSError as error:
            raise CliError(f"{path} cannot be read: {error.strerror}", code=Exit.USAGE) from error
        files = [name for name in names if name.suffix in _SUFFIXES and name.is_file()]
        if not files:
            raise CliError(f"{path} has no file *.yaml, *.yml or *.json", code=Exit.USAGE)
        yield from files


def _refuse_nothing(checked: Sequence[Checked]) -> None:
    """As `kubectl apply` does it, files that together hold nothing to check are an error: success would mean that it was checked."""
    if any(each.report.checked or each.report.findings for each in checked):
        return
    for each in checked:
        each.report.findings.append(_without_object(each.report.skipped))


def _without_object(skipped: int) -> Located:
    text = f"there is no object here; write a RobotApp (apiVersion: {API_VERSION}, kind: RobotApp), or give the file of one"
    if skipped:
        others = (
            "an object of another kind, which is" if skipped == 1 else f"{skipped} objects of other kinds, which are"
        )
        text = f"there is no {' or '.join(KINDS)} here, only {others} not checked; give the file of the RobotApp"
    return Located(Place(1, 1), Severity.ERROR, "", text, Why.NO_OBJECT, "")


def line(file: str, found: Located) -> str:
    """One finding as compilers print theirs, so that editors find the place."""
    where = f"{found.path}: " if found.path else ""
    return _one_line(f"{file}:{found.place.line}:{found.place.column}: {found.severity}: {where}{found.message}")


def _one_line(text: str) -> str:
    """Bounded and printable: text of the file may be in it."""
    cut = text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"
    return printable(cut).replace("\n", r"\n")


def _write(lines: Sequence[str]) -> None:
    encoding = sys.stdout.encoding or "utf-8"
    for each in lines:
        sys.stdout.write(each.encode(encoding, "backslashreplace").decode(encoding) + "\n")


def _count(checked: Sequence[Checked]) -> Counter[Severity]:
    return Counter(found.severity for each in checked for found in each.report.findings)


def _totals(checked: Sequence[Checked]) -> str:
    """`2 errors, 1 warning in 1 RobotApp; 3 objects of other kinds were not checked`."""
    counts, kinds = _count(checked), sum((each.report.checked for each in checked), Counter[str]())
    found = [_number(counts[severity], severity.value) for severity in Severity if counts[severity]]
    what = " and ".join(_number(kinds[kind], kind) for kind in sorted(kinds)) or "no RobotApp"
    skipped = sum(each.report.skipped for each in checked)
    noun = "object of another kind was" if skipped == 1 else "objects of other kinds were"
    more = f"; {skipped} {noun} not checked" if skipped else ""
    return f"{', '.join(found) or 'nothing wrong'} in {what}{more}"


def _number(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def _structured(checked: Sequence[Checked]) -> dict[str, Any]:
    counts = _count(checked)
    return {
        "findings": [_entry(each.name, found) for each in checked for found in each.report.findings],
        "errors": counts[Severity.ERROR],
        "warnings": counts[Severity.WARNING],
        "checked": dict(sum((each.report.checked for each in checked), Counter[str]())),
        "skipped": sum(each.report.skipped for each in checked),
    }


def _entry(file: str, found: Located) -> dict[str, str | int]:
    return {
        "file": file,
        "line": found.place.line,
        "column": found.place.column,
        "severity": found.severity.value,
        "object": found.object,
        "path": found.path,
        "reason": str(found.reason),
        "message": found.message,
    }
