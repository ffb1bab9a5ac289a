"""From jobs and sequences to the RobotApps to be."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from rigel_bridge.document.failures import BridgeError, nearest
from rigel_bridge.document.headed_template import HeadedTemplates
from rigel_bridge.document.section import Section
from rigel_bridge.document.tree import Node
from rigel_bridge.generations.dockerfile import ImageEnvironment
from rigel_bridge.generations.images import Build, build, login
from rigel_bridge.generations.jobs import Job
from rigel_bridge.generations.model import Options, Package, Step, Target

COMPONENT: Final = "ros-app"
"""The one component of a block without `components`: the container name that orchestration plugins of Rigel use."""
OURS: Final = ("rigel_bridge.RobotAppPlugin", "src.plugin.OrchestrationPlugin")
"""Plugins whose settings are an orchestration; the second is what existing Rigelfiles name."""
SETTINGS: Final = ("orchestration", "scheduler_name", "image", "namespace", "name", "output", "apply", "wait")
"""`with` of such a job. Flat keys, because an override of a sequence replaces `orchestration` as a whole."""
UPDATES: Final = ("rolling_update", "readiness", "observability", "results", "deploy_ros_master")
"""A block of these alone changes what another job deployed; by itself it would take command, volumes and scheduling away."""
MAX_APPS: Final = 64
"""Of one sequence: as many as a matrix may have combinations."""
_DEPLOY: Final = "deploy"
_BUILD: Final = "build"


@dataclass(frozen=True, slots=True)
class JobFile:
    """A Rigelfile with jobs (every generation but the first), and how it is read."""

    document: Section
    jobs: Mapping[str, Job]
    sequences: Mapping[str, tuple[Step, ...]]
    options: Options
    top: Node | None
    """`orchestration` at the top, as the thesis prints it."""

    def deploying(self) -> tuple[str, ...]:
        """Ids of the jobs that deploy."""
        return tuple(name for name, job in self.jobs.items() if self.deploys(job))

    def deploys(self, job: Job) -> bool:
        if isinstance(job.settings.value, dict) and "orchestration" in job.settings.value:
            return True
        try:
            return self.document.text_of(job.plugin) in OURS
        except BridgeError:  # a plugin named by the environment is none of ours
            return False


def targets(file: JobFile) -> tuple[tuple[Target, ...], tuple[str, ...]]:
    """The RobotApps that the options choose, and notes."""
    notes: list[str] = []
    if file.options.sequence:
        return tuple(_of_sequence(file, notes)), tuple(notes)
    return (_of_job(file, notes),), tuple(notes)


def _of_job(file: JobFile, notes: list[str]) -> Target:
    deploying, wanted = file.deploying(), file.options.job
    if wanted and wanted not in deploying:
        if wanted == _DEPLOY and file.top is not None:
            return _target(file, None, None, notes)
        known = ", ".join(deploying) or "none"
        raise file.document.node.fail(
            f"no job {wanted} deploys{nearest(wanted, list(deploying))}; jobs with an orchestration block: {known}"
        )
    if not deploying:
        if file.top is None:
            raise file.document.node.fail(
                "no job has an orchestration block: add a job with plugin: rigel_bridge.RobotAppPlugin and "
                "with: {orchestration: {…}}"
            )
        return _target(file, None, None, notes)
    if not wanted and len(deploying) > 1:
        notes.append(
            f"{file.document.node.place}: job {deploying[0]} is taken; --job chooses another: {', '.join(deploying[1:])}"
        )
    return _target(file, file.jobs[wanted or deploying[0]], None, notes)


def _of_sequence(file: JobFile, notes: list[str]) -> Iterator[Target]:
    name = file.options.sequence
    if name not in file.sequences:
        known = ", ".join(file.sequences) or "none"
        raise file.document.node.fail(
            f"there is no sequence {name}{nearest(name, list(file.sequences))}; sequences: {known}"
        )
    scheduler, before, found = "", dict[str, Job](), 0
    for step in file.sequences[name]:
        job = file.jobs.get(step.job)
        scheduler = _scheduler(file, step) or scheduler
        if job is None and (file.top is None or step.job not in (_DEPLOY, _BUILD)):
            raise step.node.fail(
                f"there is no job {step.job}{nearest(step.job, list(file.jobs))}; jobs: {', '.join(file.jobs) or 'none'}"
            )
        if job is None and step.job == _BUILD and step.overrides is not None:
            file.document.at(step.overrides).refuse_unknown(("scheduler_name", "buildargs"))
        if (step.job == _DEPLOY and job is None) or (job is not None and file.deploys(job)):
            found += 1
            if found > MAX_APPS:
                raise step.node.fail(f"sequence {name} deploys more than {MAX_APPS} RobotApps")
            target = _target(file, job, step, notes, tuple(before.values()))
            yield replace(target, scheduler=scheduler or target.scheduler, suffix=step.combination)
        elif job is not None:
            settings = _merged(file.document, job, step)
            before[job.id] = replace(job, settings=settings) if settings else job
    if not found:
        raise file.document.node.fail(f"sequence {name} has no job with an orchestration block: nothing to render")


def _scheduler(file: JobFile, step: Step) -> str:
    """`scheduler_name` of an override, of a build also as build argument: that is how the thesis writes it."""
    if step.overrides is None:
        return ""
    overrides = _with_data(file.document, step).at(step.overrides)
    arguments = overrides.section("buildargs")
    return overrides.text("scheduler_name") or (arguments.text("scheduler_name") if arguments else None) or ""


def _target(
    file: JobFile, job: Job | None, step: Step | None, notes: list[str], before: Sequence[Job] | None = None
) -> Target:
    document = _with_data(file.document, step)
    settings = _settings(document, job, step)
    orchestration = _completed(file, document, job, _orchestration(document, settings, file.top), notes)
    notes += namespace_note(settings)
    block_image = (orchestration.text("application_image") if orchestration else None) or ""
    stated = file.options.image or _stated(settings, "image") or block_image
    made = _made(file, document, before or (), needed=not stated)
    notes += [note for note in made.notes if note not in notes and not stated]
    node = job.node if job else (file.top or file.document.node)
    distro = job.distro if job else _distro_of(file)
    return Target(
        node=node,
        packages=tuple(_packages(file, document, _Default(node, stated or made.image, distro), made, orchestration)),
        orchestration=orchestration,
        job=job.id if job else _DEPLOY,
        name=_stated(settings, "name"),
        scheduler=_stated(settings, "scheduler_name"),
    )


def _made(file: JobFile, document: Section, before: Sequence[Job], *, needed: bool) -> Build:
    """What the build jobs before this one make, else those of the whole file. Mistakes in them count when it is needed."""
    try:
        made = build(document, before)
        return made if made.image else build(document, tuple(file.jobs.values()))
    except BridgeError:
        if needed:
            raise
        return Build()


def namespace_note(settings: Section | None) -> tuple[str, ...]:
    """The namespace of the file is not carried over: the user who applies the app chooses it."""
    chosen = settings.get("namespace") if settings else None
    if chosen is None:
        return ()
    return (
        f"{chosen.place}: {chosen.path} is not carried over: the command line names the namespace (-n), not the file",
    )


def _stated(settings: Section | None, key: str) -> str:
    return (settings.text(key) if settings else None) or ""


def _with_data(document: Section, step: Step | None) -> Section:
    templates = document.templates
    if step is None or not step.data or not isinstance(templates, HeadedTemplates):
        return document
    return Section(document.node, templates.with_data(step.data))


def _settings(document: Section, job: Job | None, step: Step | None) -> Section | None:
    """The settings of a job that deploys."""
    merged = _merged(document, job, step)
    if merged is None:
        return None
    section = Section(merged, document.templates)
    section.refuse_unknown(SETTINGS)
    return section


def _merged(document: Section, job: Job | None, step: Step | None) -> Node | None:
    """The job's `with` and the step's overrides over it: one level deep, as Rigel does it."""
    merged: dict[str, Node] = {}
    own = job.settings if job else None
    if own is not None and own.kind != "null":
        merged.update(document.at(own).node.mapping())
    overrides = step.overrides if step else None
    if overrides is not None:
        merged.update(overrides.mapping())
    place = own or overrides
    return None if place is None else replace(place, value=merged, kind="map")


def _orchestration(document: Section, settings: Section | None, top: Node | None) -> Section | None:
    own = settings.section("orchestration") if settings else None
    if own is not None and top is not None:
        raise own.node.fail(f"orchestration is already in line {top.place.line}: keep one")
    if own is not None:
        return own
    return document.at(top) if top is not None else None


def _completed(
    file: JobFile, document: Section, job: Job | None, block: Section | None, notes: list[str]
) -> Section | None:
    """The block of a job that only updates, laid over that of the first job that deploys, key by key."""
    if job is None or block is None or not block.node.mapping() or not set(block.node.mapping()) <= set(UPDATES):
        return block
    first = file.jobs[file.deploying()[0]]
    whole = _settings(document, first, None)
    under = whole.section("orchestration") if whole else None
    if first.id == job.id or under is None:
        return block
    notes.append(
        f"{block.node.place}: job {job.id} only updates: it is laid over job {first.id} of line {first.node.place.line}"
    )
    merged = {**under.node.mapping(), **block.node.mapping()}
    return Section(replace(block.node, value=merged), document.templates)


def _distro_of(file: JobFile) -> Node | None:
    application = file.document.section("application")
    return application.get("distro") if application else None


@dataclass(frozen=True, slots=True)
class _Default:
    """What a component of a job has unless its own entry states otherwise."""

    node: Node
    image: str
    distro: Node | None


def _packages(
    file: JobFile, document: Section, default: _Default, build: Build, block: Section | None
) -> Iterator[Package]:
    """Yields one component per entry of the block's `components`, all of the job's image; one alone without entries."""
    components = block.section("components") if block else None
    if components is None or not components.node.mapping():
        yield _package(file, document, COMPONENT, default, build)
        return
    for name, node in components.node.mapping().items():
        entry = components.at(node)
        image = entry.text("image") or default.image
        yield _package(file, document, name, replace(default, node=entry.node, image=image), build)


def _package(file: JobFile, document: Section, name: str, default: _Default, build: Build) -> Package:
    """Returns one component. Command and variables of the container file belong to the built image alone."""
    is_built = default.image == build.image
    return Package(
        node=default.node,
        name=name,
        image=default.image,
        distro=file.options.distro or (document.text_of(default.distro) if default.distro else None),
        command=build.command if is_built else None,
        env=build.env if is_built else ImageEnvironment(),
        login=login(document, default.image),
        builders=build.builders,
    )
