"""From a text to its findings: which objects it holds, and every check over each of them."""

import difflib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Final

from robotapp_api.model.names import API_VERSION, GROUP
from robotapp_api.schema.crd import KINDS as OUR_KINDS
from robotapp_cli.lint import wording
from robotapp_cli.lint.checks import CHECKS
from robotapp_cli.lint.definitions import KINDS, definition
from robotapp_cli.lint.findings import Finding, Located, Path, Place, Why, shown
from robotapp_cli.lint.reading import Document, Node, UnreadableError, read, text_of
from robotapp_cli.lint.subject import Subject

MOST_FINDINGS: Final = 200
"""Of one object: a file with more errors is something else than a RobotApp."""
_OURS: Final = frozenset(model.__name__ for model in OUR_KINDS)
_SIMILAR: Final = 0.8


@dataclass(slots=True)
class Report:
    """What is wrong with one text, in the order of its lines."""

    findings: list[Located] = field(default_factory=list)
    checked: Counter[str] = field(default_factory=Counter)
    """Objects that were checked, by kind."""
    skipped: int = 0
    """Objects of other kinds."""


def lint(data: bytes) -> Report:
    """Check the objects of a YAML or JSON text."""
    report = Report()
    try:
        for document in read(text_of(data)):
            report.findings += (
                _located(Finding((), text, reason=Why.BAD_YAML), place) for place, text in document.problems
            )
            for at in _objects(document.root):
                _check(document, at, report)
    except UnreadableError as error:
        report.findings.append(_located(Finding((), error.message, reason=Why.BAD_YAML), error.place))
    report.findings.sort(key=lambda each: (each.place, each.severity, each.path))
    return report


def _located(finding: Finding, place: Place, *, path: Path = (), name: str = "") -> Located:
    return Located(place, finding.severity, shown((*path, *finding.path)), finding.message, finding.reason, name)


def _objects(root: Node) -> Iterator[Path]:
    """Where the objects of a document stand: lists are taken apart."""
    value = root.value
    if isinstance(value, dict) and str(value.get("kind", "")).endswith("List"):
        items = value.get("items")
        yield from (("items", index) for index in range(len(items) if isinstance(items, list) else 0))
    else:
        yield ()


def _check(document: Document, at: Path, report: Report) -> None:
    node = document.root.at(at) or document.root
    kind, refusal = _kind(node.value)
    if refusal:
        place = document.root.place_of((*at, *refusal.path))
        report.findings.append(_located(refusal, place, path=at))
    elif not kind:
        report.skipped += 1
    else:
        report.checked[kind] += 1
        subject = Subject(definition(kind), document.root, at, node.value)
        for finding in _found(subject):
            place = document.root.place_of((*at, *finding.path), at_key=finding.at_key)
            report.findings.append(_located(finding, place, path=at, name=subject.title))


def _found(subject: Subject) -> list[Finding]:
    """The findings of all checks, each once."""
    for check in CHECKS:
        subject.found += [finding for finding in check(subject) if finding not in subject.found]
        if len(subject.found) > MOST_FINDINGS:
            text = "more findings are left out from here on; mend those that are shown first"
            return [
                *subject.found[:MOST_FINDINGS],
                Finding(subject.found[MOST_FINDINGS].path, text, reason=Why.TOO_MANY),
            ]
    return subject.found


def _kind(value: Any) -> tuple[str, Finding | None]:
    """The kind to check an object as, "" for one of others; and what is wrong where neither can be said."""
    if not isinstance(value, dict):
        text = "an object is a mapping of fields; write apiVersion, kind, metadata and spec"
        return "", Finding((), text, reason=Why.NO_OBJECT)
    kind, version = value.get("kind"), value.get("apiVersion")
    if not isinstance(kind, str):
        text = f"this field is missing or no text; write kind: RobotApp, and apiVersion: {API_VERSION} beside it"
        return "", Finding(("kind",), text, reason=Why.NO_OBJECT)
    ours = isinstance(version, str) and version.partition("/")[0] == GROUP
    if kind in KINDS and (ours or _meant(version)):
        return kind, None
    if ours and kind not in _OURS:
        near = wording.nearest(kind, _OURS)
        cure = f"did you mean {near}?" if near else f"kinds of {GROUP} are {', '.join(sorted(_OURS))}"
        return "", Finding(("kind",), f"{wording.quoted(kind)} is no kind of {version}; {cure}", reason=Why.WRONG_VALUE)
    return "", None


def _meant(version: object) -> bool:
    """Whether the version of a RobotApp is absent, without a group, or a misspelling of ours, rather than another group's."""
    if not isinstance(version, str) or "/" not in version:
        return True
    group = version.partition("/")[0]
    return difflib.SequenceMatcher(None, group[:80], GROUP).ratio() > _SIMILAR
