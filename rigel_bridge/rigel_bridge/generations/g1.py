"""The Rigelfile of Rigel 0.2 (`packages`, `deploy`, `simulate`, `vars`), as far as a deployment needs it.

Build-time fields (apt, rosinstall, ssh keys, …) are left to Rigel: they are inside the image by then. Rigel ignores keys
it does not know; here they are errors, because a misspelt key is a lost setting.
"""

from dataclasses import replace
from typing import Final

from rigel_bridge.document.failures import BridgeError, nearest
from rigel_bridge.document.section import Section
from rigel_bridge.document.tree import Node
from rigel_bridge.generations.images import environment
from rigel_bridge.generations.model import Generation, Options, Package, Rigelfile, Step, Target
from rigel_bridge.generations.sequences import sequences
from rigel_bridge.generations.targets import SETTINGS, namespace_note

MODULE: Final = "rigel_bridge"
JOB: Final = "deploy"
"""What the `deploy` list stands for where a job is named."""
KWARGS: Final = (*SETTINGS, "sequences")
PACKAGE: Final = (
    *("package", "image", "distro", "command", "env", "registry", "dockerfile", "apt", "compiler", "dir", "entrypoint"),
    *("hostname", "platforms", "ros_image", "rosinstall", "run", "ssh", "username"),
)


def load(document: Section, evidence: str, options: Options) -> Rigelfile:
    """Check and read a document of generation G1; BridgeError otherwise."""
    packages = tuple(_package(section, options) for section in document.sections("packages"))
    if not packages:
        raise document.node.fail("packages needs at least one entry")
    _refuse_twins(packages)
    if options.job not in ("", JOB):
        raise document.node.fail(f"a list of packages has no jobs: leave --job {options.job} out, or write {JOB}")
    settings = _settings(document)
    known = _sequences(document, settings)
    orchestration = _orchestration(document, settings)
    target = Target(
        node=document.node,
        packages=_with_image(packages, options.image or _stated(settings, "image"), orchestration),
        orchestration=orchestration,
        job=JOB,
        name=(settings.text("name") if settings else None) or "",
        scheduler=_scheduler(document, known, options.sequence) or _stated(settings, "scheduler_name"),
    )
    notes = namespace_note(settings)
    return Rigelfile(document.node, Generation.G1, evidence, (target,), (JOB,), known, notes)


def _stated(settings: Section | None, key: str) -> str:
    return (settings.text(key) if settings else None) or ""


def _package(section: Section, options: Options) -> Package:
    section.refuse_unknown(PACKAGE)
    own_dockerfile = "dockerfile" in section and "command" not in section
    registry = section.section("registry")
    return Package(
        node=section.node,
        name=section.required_text("package"),
        image=section.required_text("image"),
        distro=options.distro or (section.text("distro") if own_dockerfile else section.required_text("distro")),
        command=section.text("command") if own_dockerfile else section.required_text("command"),
        env=environment(section),
        login=(registry.text("server") or "" if registry else ""),
    )


def _with_image(packages: tuple[Package, ...], image: str, block: Section | None) -> tuple[Package, ...]:
    """The one package with the image that was given on the command line, beside the block or in it."""
    if image and len(packages) > 1:
        raise packages[0].node.fail(
            "has its own image, as each of the packages: leave out the one image (--image, or image beside orchestration)"
        )
    single_image = block.get("application_image") if block else None
    if single_image and len(packages) > 1:
        raise single_image.fail("is one image, but there are several packages: each has its own image field")
    if not image and block is not None:
        image = block.text("application_image") or ""
    return (replace(packages[0], image=image),) if image else packages


def _refuse_twins(packages: tuple[Package, ...]) -> None:
    seen: dict[str, Package] = {}
    for package in packages:
        first = seen.setdefault(package.name, package)
        if first is not package:
            raise package.node.fail(f"package {package.name} is already in line {first.node.place.line}")


def _settings(document: Section) -> Section | None:
    """`kwargs` of the deploy entry that is the bridge's, by its module or by the block it has."""
    found: list[Section] = []
    for entry in document.sections("deploy"):
        entry.refuse_unknown(("name", "args", "kwargs", "entrypoint"))
        kwargs = entry.section("kwargs")
        if kwargs is None:
            continue
        name = entry.get("name")
        ours = name is not None and str(name.value).rpartition("/")[2] == MODULE
        if ours or "orchestration" in kwargs:
            kwargs.refuse_unknown(KWARGS)
            found.append(kwargs)
    if len(found) > 1:
        first = (found[0].get("orchestration") or found[0].node).place.line
        raise (found[1].get("orchestration") or found[1].node).fail(
            f"orchestration is already in line {first}: keep one"
        )
    return found[0] if found else None


def _orchestration(document: Section, settings: Section | None) -> Section | None:
    """The deploy entry's block, or `orchestration` at the top as older descriptions show it."""
    found = [document.get("orchestration"), settings.get("orchestration") if settings else None]
    blocks = [node for node in found if node is not None]
    if len(blocks) > 1:
        raise blocks[1].fail(f"orchestration is already in line {blocks[0].place.line}: keep one")
    return document.at(blocks[0]) if blocks else None


def _sequences(document: Section, settings: Section | None) -> dict[str, tuple[Step, ...]]:
    """The thesis' sequences, which Rigel 0.2 has no place for: at the top, or handed to the plugin."""
    found: dict[str, tuple[Step, ...]] = {}
    where: dict[str, Node] = {}
    for holder in (document, settings):
        if holder is None:
            continue
        for name, steps in sequences(holder).items():
            node = (holder.get("sequences") or holder.node).mapping()[name]
            if name in found:
                raise node.fail(f"sequence {name} is already in line {where[name].place.line}: keep one")
            found[name], where[name] = steps, node
    for steps in found.values():
        for step in steps:
            if step.job not in ("build", JOB):
                raise step.node.fail(f"there is no job {step.job}; Rigel 0.2 has two: build, {JOB}")
    return found


def sequence_names(document: Section) -> tuple[str, ...]:
    """Names of the sequences; none when they cannot be read, which `load` reports."""
    try:
        return tuple(_sequences(document, _settings(document)))
    except BridgeError:
        return ()


def _scheduler(document: Section, known: dict[str, tuple[Step, ...]], wanted: str) -> str:
    if not wanted:
        return ""
    if wanted not in known:
        listed = ", ".join(known) or "none"
        raise document.node.fail(f"there is no sequence {wanted}{nearest(wanted, list(known))}; sequences: {listed}")
    scheduler = ""
    for step in known[wanted]:
        if step.overrides is not None:
            overrides = document.at(step.overrides)
            overrides.refuse_unknown(("scheduler_name", "buildargs"))
            scheduler = overrides.text("scheduler_name") or scheduler
    return scheduler
