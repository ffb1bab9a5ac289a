"""The jobs of a Rigelfile, wherever a generation keeps them."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from rigel_bridge.document.section import Section
from rigel_bridge.document.tree import Node
from rigel_bridge.generations.model import Generation


@dataclass(frozen=True, slots=True)
class Job:
    """One job with its settings. `distro` is that of the application it belongs to."""

    id: str
    node: Node
    plugin: Node
    settings: Node
    """What stands under `with`: a mapping, or null."""
    distro: Node | None


def jobs_of(document: Section, generation: Generation) -> dict[str, Job]:
    """Every job by id; BridgeError for one that is there twice."""
    found: dict[str, Job] = {}
    for job in _READERS[generation](document):
        if job.id in found:
            raise job.node.fail(f"job {job.id} is already in line {found[job.id].node.place.line}")
        found[job.id] = job
    return found


def _current(document: Section) -> Iterator[Job]:
    """0.3 and newer: `jobs: {id: {plugin, with}}`, one application."""
    distro = None
    if application := document.section("application"):
        application.refuse_unknown(("distro", "dir"))
        distro = application.get("distro")
    yield from _mapped(document.section("jobs"), distro)


def _packages(document: Section) -> Iterator[Job]:
    """The draft with packages as a mapping: jobs at the top and below each package."""
    distro = document.get("distro")
    yield from _mapped(document.section("jobs"), distro)
    packages = document.section("packages")
    for _, node in packages.node.mapping().items() if packages else ():
        package = document.at(node)
        package.refuse_unknown(("jobs", "dir", "ssh"))
        yield from _mapped(package.section("jobs"), distro)


def _applications(document: Section) -> Iterator[Job]:
    """The draft with several applications: each has its own distro and jobs."""
    applications = document.section("applications")
    for _, node in applications.node.mapping().items() if applications else ():
        application = document.at(node)
        application.refuse_unknown(("distro", "dir", "jobs"))
        yield from _mapped(application.section("jobs"), application.get("distro"))


def _mapped(jobs: Section | None, distro: Node | None) -> Iterator[Job]:
    for name, node in jobs.node.mapping().items() if jobs else ():
        if jobs is None:
            continue
        entries = jobs.templates.resolve(node)
        # The first draft has a list of plugins per job; one is what everybody wrote.
        for entry in entries.sequence() if entries.kind == "seq" else (node,):
            section = jobs.at(entry)
            section.refuse_unknown(("plugin", "with"))
            plugin = section.get("plugin")
            if plugin is None:
                raise section.node.fail("plugin is missing")
            settings = section.node.mapping().get("with")
            if settings is None:
                raise section.node.fail("with is missing; a job without settings has with: {}")
            yield Job(name, entry, plugin, settings, distro)


_READERS: Final[Mapping[Generation, Callable[[Section], Iterator[Job]]]] = {
    Generation.G2A: _packages,
    Generation.G2B: _applications,
    Generation.G3: _current,
    Generation.THESIS: _current,
}
