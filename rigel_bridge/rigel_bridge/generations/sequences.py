"""Sequences in all their forms, as plain lists of jobs.

Rigel 0.3: `stages` with jobs, dependencies, parallel and matrix. The thesis and the drafts: a list of jobs, each an id or
`{id: overrides}`. A matrix stands for one run per combination, as Rigel does it.
"""

from collections.abc import Iterator, Mapping
from hashlib import sha256
from itertools import islice, product
from typing import Final

from rigel_bridge.document.naming import label
from rigel_bridge.document.section import Section
from rigel_bridge.document.tree import Node
from rigel_bridge.generations.model import Step

MAX_STEPS: Final = 512
MAX_COMBINATIONS: Final = 64
_STAGE: Final = ("jobs", "dependencies", "parallel", "matrix", "description")


def sequences(document: Section) -> dict[str, tuple[Step, ...]]:
    """Every sequence by name."""
    found = document.section("sequences")
    if found is None:
        return {}
    left, steps = MAX_STEPS, dict[str, tuple[Step, ...]]()
    for name, node in found.node.mapping().items():
        steps[name] = tuple(islice(_sequence(found, node), left + 1))
        left -= len(steps[name])
        if left < 0:
            raise node.fail(f"all sequences run more than {MAX_STEPS} jobs, counting each combination of a matrix")
    return steps


def _sequence(parent: Section, node: Node) -> Iterator[Step]:
    resolved = parent.templates.resolve(node)
    return _plain(parent, resolved) if resolved.kind == "seq" else _staged(parent.at(resolved))


def _plain(parent: Section, node: Node) -> Iterator[Step]:
    """`[{build: {scheduler_name: X}}, deploy]`"""
    for entry in node.sequence():
        found = parent.templates.resolve(entry)
        if isinstance(found.value, str):
            yield Step(found.value, entry)
            continue
        mapping = found.mapping()
        if len(mapping) != 1:
            raise entry.fail("expected a job, or one job with its overrides: {build: {scheduler_name: …}}")
        ((job, overrides),) = mapping.items()
        yield Step(job, entry, None if overrides.kind == "null" else parent.at(overrides).node)


def _staged(section: Section) -> Iterator[Step]:
    section.refuse_unknown(("stages", "matrix", "description"))
    if "stages" not in section:
        raise section.node.fail("stages is missing")
    for stage in section.sections("stages"):
        yield from _stage(stage)


def _stage(stage: Section) -> Iterator[Step]:
    stage.refuse_unknown(_STAGE)
    if "parallel" not in stage:
        if matrix := stage.get("matrix"):
            raise matrix.fail("belongs to a stage with parallel")
        yield from _jobs(stage, {}, "")
        return
    if jobs := stage.get("jobs"):
        raise jobs.fail("stands beside parallel: put the jobs into an entry of parallel")
    for data, combination in _combinations(stage):
        for entry in stage.sections("parallel"):
            entry.refuse_unknown(("jobs", "dependencies", "description"))
            yield from _jobs(entry, data, combination)


def _jobs(stage: Section, data: Mapping[str, Node], combination: str) -> Iterator[Step]:
    if "jobs" not in stage:
        raise stage.node.fail("jobs is missing")
    for key in ("dependencies", "jobs"):
        listed = stage.resolved(key)
        for entry in listed.sequence() if listed else ():
            yield _job(stage, entry, data, combination)


def _job(stage: Section, entry: Node, data: Mapping[str, Node], combination: str) -> Step:
    found = stage.templates.resolve(entry)
    if isinstance(found.value, str):
        return Step(found.value, entry, None, data, combination)
    section = stage.at(found)
    section.refuse_unknown(("name", "with"))
    overrides = section.section("with")
    return Step(section.required_text("name"), entry, overrides.node if overrides else None, data, combination)


def _combinations(stage: Section) -> Iterator[tuple[dict[str, Node], str]]:
    matrix = stage.section("matrix")
    if matrix is None:
        yield {}, ""
        return
    axes = {key: stage.templates.resolve(node).sequence() for key, node in matrix.node.mapping().items()}
    count = 1
    for key, values in axes.items():
        count *= len(values)
        if count > MAX_COMBINATIONS:
            raise matrix.node.fail(f"has more than {MAX_COMBINATIONS} combinations")
        if not values:
            raise matrix.node.mapping()[key].fail("needs at least one value")
    for chosen in product(*axes.values()):
        data = dict(zip(axes, chosen, strict=True))
        yield data, _suffix(data)


def _suffix(data: Mapping[str, Node]) -> str:
    """Stable and short: the values themselves where they make a name, and a hash of all, which keeps 1 and "1" apart."""
    text = ";".join(f"{key}={node.kind}:{node.raw}" for key, node in sorted(data.items()))
    readable = label("-".join(node.raw for node in data.values()))[:12].strip("-")
    digest = sha256(text.encode()).hexdigest()[:6]
    return f"{readable}-{digest}" if readable else digest
