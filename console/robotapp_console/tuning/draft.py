"""A configuration that somebody edits: its fields, its text with changed lines marked, and what is wrong with it."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

from robotapp_console.tuning.check import Problem, check
from robotapp_console.tuning.form import ProfileForm, apply_form, build_form, write_yaml
from robotapp_console.tuning.lines import Line, count_changes, mark_lines
from robotapp_console.tuning.plugins import count_entries
from robotapp_console.views.texts import clean
from robotapp_scheduler.config.editing import Document, read_document
from robotapp_scheduler.config.load import ConfigError

MOST_TEXT: Final = 48 * 1024
"""Characters. A longer configuration is shown, and edited elsewhere."""
MOST_LINES: Final = 3000
"""Lines of a configuration that is edited, and of a comparison that is shown."""
MOST_PROFILES: Final = 10
MOST_ENTRIES: Final = 300
"""Names of plugins in all lists."""
_LONGEST_LINE: Final = 500


@dataclass(frozen=True, slots=True)
class Stored:
    """The configuration in the ConfigMap, as far as it can be read. `text` is as it was written, comments included."""

    text: str
    document: Document | None = None
    problem: str = ""

    @property
    def canonical(self) -> str:
        """Returns the text as the form writes it, to compare with."""
        return write_yaml(self.document) if self.document is not None else self.text


@dataclass(frozen=True)
class Draft:
    """`base` is the text whose fields the form shows; `text` is what would be applied."""

    base: str
    text: str
    form: tuple[ProfileForm, ...] = ()
    problems: tuple[Problem, ...] = ()
    warnings: tuple[str, ...] = ()
    lines: tuple[Line, ...] = ()
    """At most MOST_LINES."""
    changes: int = 0
    """Lines that differ from the configuration in the ConfigMap, also those that are not shown."""
    hidden: int = 0
    """Lines that are not shown."""
    is_compared: bool = True
    """False for a text that is too long to be compared with the ConfigMap."""
    document: Document | None = None
    entered: Mapping[str, str] = field(default_factory=dict)
    """Texts of fields that cannot be read, by id."""

    @cached_property
    def problems_by_field(self) -> dict[str, list[str]]:
        """Returns the mistakes by the id of their field or section."""
        by_field: dict[str, list[str]] = {}
        for problem in self.problems:
            by_field.setdefault(problem.field, []).append(problem.text)
        return by_field

    @property
    def may_be_applied(self) -> bool:
        return not self.problems and (bool(self.changes) or not self.is_compared)


def read_stored(text: str) -> Stored:
    """Returns the ConfigMap's text with its document, or why it has none."""
    if problem := _find_excess(text):
        return Stored(text, None, problem)
    try:
        document = read_document(text)
    except ConfigError as error:
        return Stored(text, None, "; ".join(error.problems))
    profiles, entries = len(document.get("profiles", [])), count_entries(document)
    if profiles > MOST_PROFILES or entries > MOST_ENTRIES:
        words = f"it has {profiles} profiles that name {entries} plugins"
        return Stored(text, None, f"{words}, and at most {MOST_PROFILES} and {MOST_ENTRIES} are edited here")
    return Stored(text, document)


def _find_excess(text: str) -> str:
    """Returns why a text is too long to be read; empty when it is not."""
    if len(text) > MOST_TEXT:
        return f"it has {len(text)} characters, and at most {MOST_TEXT} are edited here"
    lines = len(text.splitlines())
    return f"it has {lines} lines, and at most {MOST_LINES} are edited here" if lines > MOST_LINES else ""


def make_draft(stored: Stored, base: str, fields: Mapping[str, str] | None, *, running: str = "") -> Draft:
    """Returns the draft that the filled-in `fields` of the text `base` mean; None: the text as it is.

    `running` is the text in use: what cannot change while the scheduler runs is named in a warning.
    """
    base_text = read_stored(base)
    if base_text.document is None:
        return _add_comparison(Draft(base, base, problems=_name_problems(base_text)), stored.text, base)
    document, field_problems = base_text.document, dict[str, str]()
    if fields is not None:
        document, field_problems = apply_form(base_text.document, fields)
    is_stored = document == stored.document
    text = stored.text if is_stored else base if document == base_text.document else write_yaml(document)
    verdict = check(document)
    problems = (*(Problem(text, name) for name, text in field_problems.items()), *verdict.problems)
    draft = Draft(
        base=text,
        text=text,
        form=build_form(document),
        problems=tuple(Problem(clean(problem.text), problem.field) for problem in problems),
        warnings=tuple(clean(warning) for warning in (*verdict.warnings, *_find_restarts(running, document))),
        document=document,
        entered={name: (fields or {}).get(name, "") for name in field_problems},
    )
    return _add_comparison(draft, stored.canonical, stored.canonical if is_stored else write_yaml(document))


def _name_problems(text: Stored) -> tuple[Problem, ...]:
    return (Problem(clean(text.problem)),)


def _find_restarts(running: str, document: Document) -> list[str]:
    """Returns a sentence per field that differs from the configuration in use and cannot change while the scheduler runs."""
    config = check(document).config
    running_text = read_stored(running) if running else Stored("")
    if config is None or running_text.document is None:
        return []
    running_config = check(running_text.document).config
    paths = running_config.restart_needed(config) if running_config is not None else ()
    return [
        f"{path} cannot change while the scheduler runs: it goes on as before until it is restarted" for path in paths
    ]


def _add_comparison(draft: Draft, before: str, after: str) -> Draft:
    """Returns the draft with the lines of `after`, as far as they are shown, and how many of them all differ."""
    if before == after:
        lines = tuple(Line(text) for text in after.splitlines())
    elif _find_excess(before) or _find_excess(after):
        return replace(draft, is_compared=False)
    else:
        lines = mark_lines(before, after)
    shown_lines = tuple(Line(clean(line.text, _LONGEST_LINE), line.mark) for line in lines[:MOST_LINES])
    return replace(draft, lines=shown_lines, changes=count_changes(lines), hidden=len(lines) - len(shown_lines))
