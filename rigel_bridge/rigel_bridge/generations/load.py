"""Any Rigelfile to the RobotApps to be: the way in for all generations."""

from dataclasses import dataclass, replace
from typing import Final

from rigel_bridge.document.failures import BridgeError, nearest
from rigel_bridge.document.headed_template import HeadedTemplates
from rigel_bridge.document.section import Resolver, Section
from rigel_bridge.document.template import Templates
from rigel_bridge.document.tree import Node
from rigel_bridge.generations import g1
from rigel_bridge.generations.detect import detect
from rigel_bridge.generations.jobs import jobs_of
from rigel_bridge.generations.lint import lint
from rigel_bridge.generations.model import Generation, Options, Rigelfile
from rigel_bridge.generations.sequences import sequences
from rigel_bridge.generations.targets import JobFile, targets

_SECOND: Final = ("application", "orchestration", "sequences", "vars")
"""Keys of a second file: Rigel 0.3 refuses a file that has `orchestration` at its top."""
_DRAFTS: Final = (Generation.G2A, Generation.G2B)


@dataclass(frozen=True, slots=True)
class Outline:
    """What is known of a file before a job of it is chosen."""

    generation: Generation
    evidence: str
    jobs: tuple[str, ...]
    """Those that deploy."""
    sequences: tuple[str, ...]
    """Those with a job that deploys, or that is not there."""
    errors: tuple[BridgeError, ...]
    notes: tuple[str, ...]


def outline(root: Node, options: Options) -> Outline:
    """Generation, choices, and what Rigel itself would refuse. BridgeError when the file cannot be read at all."""
    generation, evidence = detect(root)
    document = _document(root, generation, options)
    errors, notes = lint(document, generation)
    if generation is Generation.G1:
        return Outline(generation, evidence, (), g1.sequence_names(document), tuple(errors), tuple(notes))
    file = _job_file(document, generation, options)
    deploying = file.deploying()
    skipped = set(file.jobs) - {*deploying}
    chosen = tuple(name for name, steps in file.sequences.items() if any(step.job not in skipped for step in steps))
    return Outline(generation, evidence, deploying, chosen, tuple(errors), tuple(notes))


def load(root: Node, options: Options) -> Rigelfile:
    """Check and read a document of any generation; BridgeError otherwise."""
    generation, evidence = detect(root)
    document = _document(root, generation, options)
    if generation is Generation.G1:
        return g1.load(document, evidence, options)
    file = _job_file(document, generation, options)
    found, notes = targets(file)
    return Rigelfile(root, generation, evidence, found, file.deploying(), file.sequences, notes)


def _job_file(document: Section, generation: Generation, options: Options) -> JobFile:
    return JobFile(
        document=document,
        jobs=jobs_of(document, generation),
        sequences=sequences(document),
        options=options,
        top=document.get("orchestration"),
    )


def _document(root: Node, generation: Generation, options: Options) -> Section:
    templates = _templates(root, generation, options)
    return Section(templates.keys(root) if isinstance(templates, HeadedTemplates) else root, templates)


def _templates(root: Node, generation: Generation, options: Options) -> Resolver:
    variables = root.mapping().get("vars")
    values = variables.mapping() if variables is not None and variables.kind != "null" else {}
    if generation is Generation.G1:
        return Templates(values, options.environment)
    if generation in _DRAFTS:
        return Templates(values, reads_environment=False)
    return HeadedTemplates(values, options.environment)


def completed_by(root: Node, other: Node) -> Node:
    """The Rigelfile with the keys of the other file added. A key that both have is an error, except `vars`, which are joined."""
    top = dict(root.mapping())
    for key, node in other.mapping().items():
        if key not in _SECOND:
            raise node.fail(f"is not known beside a Rigelfile{nearest(key, [*_SECOND])}; known: {', '.join(_SECOND)}")
        if key == "vars" and key in top:
            top[key] = _joined(top[key], node)
        elif key in top:
            raise node.fail(f"is already in {top[key].place}: keep one")
        else:
            top[key] = node
    return replace(root, value=top)


def _joined(first: Node, second: Node) -> Node:
    values = dict(first.mapping())
    for name, node in second.mapping().items():
        if name in values:
            raise node.fail(f"is already in {values[name].place}: keep one")
        values[name] = node
    return replace(first, value=values)
