"""`rigel-bridge check`: mistakes in every job and sequence of a Rigelfile, and in what Rigel itself reads, without a cluster."""

import argparse
import sys
from collections.abc import Iterator
from dataclasses import replace
from typing import Final

from rigel_bridge.document.failures import BridgeError, Exit, printable
from rigel_bridge.document.tree import is_within, mended
from rigel_bridge.source import Objects, Source, examine, from_root, parsed, read_bytes
from rigel_bridge.verbs.options import add_source, source_of
from rigel_bridge.verbs.verb import Verb

MOST_ERRORS: Final = 20
"""Of one job or sequence."""
_IN_TURN: Final = (
    "after an error the rest is read as if what it is about were as advised, or left out; mend the first ones first"
)


def _run(arguments: argparse.Namespace) -> int:
    source = source_of(arguments)
    data = read_bytes(source.path)
    examined = examine(data, source)
    errors: dict[str, Exit] = {str(error): error.code for error in examined.errors}
    notes: dict[str, None] = dict.fromkeys(examined.notes)
    apps: list[str] = []
    in_turn = False
    for choice in _choices(source, examined.jobs, examined.sequences):
        mistakes, found = _mistakes(data, choice)
        errors = {**errors, **{str(error): error.code for error in mistakes if str(error) not in errors}}
        in_turn = in_turn or len(mistakes) > 1
        if found is None:
            continue
        notes.update(dict.fromkeys(found.notes))
        names = ", ".join(app["metadata"]["name"] for app in found.apps)
        apps.append(f"{_chosen(choice)}: RobotApp {names}")
    lines = [f"error: {error}" for error in errors]
    lines += [_IN_TURN] if in_turn else []
    lines += [f"note: {note}" for note in notes if note not in errors]
    lines += [f"generation {examined.generation}: {examined.evidence}", *apps]
    refused = bool(notes) and arguments.strict
    if refused and not errors:
        lines.append(f"error: {arguments.rigelfile}: has notes, and --strict allows none")
    sys.stdout.write("".join(f"{printable(line)}\n" for line in lines))
    if errors:
        return next(iter(errors.values()))
    return Exit.INVALID if refused else Exit.OK


def _mistakes(data: bytes, source: Source) -> tuple[list[BridgeError], Objects | None]:
    """What is wrong with one choice: after an error the file is read again as if that were mended. Its objects if nothing is."""
    errors: list[BridgeError] = []
    root = parsed(data, source)
    while len(errors) < MOST_ERRORS:
        try:
            found = from_root(root, data, source)
        except BridgeError as error:
            # About the surroundings of an earlier one: it may be there only for what was left out.
            if any(is_within(earlier.path, error.path) for earlier in errors):
                break
            errors.append(error)
            root, before = mended(root, error), root
            if root == before:
                break
        else:
            return errors, None if errors else found
    return errors, None


def _choices(source: Source, jobs: tuple[str, ...], sequences: tuple[str, ...]) -> Iterator[Source]:
    """What the user chose, else the default and every other choice there is."""
    yield source
    if source.options.job or source.options.sequence:
        return
    for job in jobs[1:]:
        yield replace(source, options=replace(source.options, job=job))
    for sequence in sequences:
        yield replace(source, options=replace(source.options, sequence=sequence))


def _chosen(choice: Source) -> str:
    if choice.options.job:
        return f"--job {choice.options.job}"
    return f"--sequence {choice.options.sequence}" if choice.options.sequence else "by default"


CHECK: Final = Verb(
    name="check",
    summary="look for mistakes in every job and sequence, without a cluster",
    description="Look for mistakes in every job and sequence of a Rigelfile, and for what Rigel itself would refuse.",
    arguments=add_source,
    run=_run,
    examples=(
        ("rigel-bridge check", "every job and sequence of ./Rigelfile"),
        ("rigel-bridge check ws/Rigelfile --strict", "in CI: notes are errors, too"),
        ("rigel-bridge check --sequence demo", "one sequence alone"),
    ),
)
