"""Which image a job deploys: what a build job before it makes."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from rigel_bridge.document.failures import BridgeError
from rigel_bridge.document.section import Section
from rigel_bridge.generations.dockerfile import DockerError, ImageEnvironment, read_env
from rigel_bridge.generations.jobs import Job

BUILDERS: Final = ("BuildXPlugin", "BuildPlugin")
FILE_WRITERS: Final = ("DockerfilePlugin", "ContainerfilePlugin")
_TAGGED: Final = re.compile(r":[^:/]+$")


@dataclass(frozen=True, slots=True)
class Build:
    """What the jobs before a deployment make."""

    image: str = ""
    command: str | None = None
    env: ImageEnvironment = ImageEnvironment()  # noqa: RUF009 - frozen, so one for all is no trap
    notes: tuple[str, ...] = ()
    builders: tuple[str, ...] = ()
    """Ids of the build jobs, of which one is needed."""


def build(document: Section, jobs: Sequence[Job]) -> Build:
    """The image of the one build job among `jobs`, with command and variables of its container file; empty when there is none or several."""
    builders = [job for job in jobs if kind(document, job) in BUILDERS]
    writers = [job for job in jobs if kind(document, job) in FILE_WRITERS]
    if len(builders) != 1:
        return Build(builders=tuple(job.id for job in builders))
    settings = document.at(builders[0].settings)
    image, notes = _image(settings)
    if len(writers) != 1 or writers[0].settings.kind == "null":
        return Build(image, notes=notes)
    written = document.at(writers[0].settings)
    return Build(image, written.text("command") or None, environment(written), notes)


def kind(document: Section, job: Job) -> str:
    """Class name of the job's plugin; empty when it is not known without the environment."""
    try:
        return document.text_of(job.plugin).rpartition(".")[2]
    except BridgeError:
        return ""


def environment(section: Section) -> ImageEnvironment:
    """`env: [{name, value}]` as Docker reads it from ENV; as typed, because YAML 1.1 would turn an unquoted `on` into true."""
    found: dict[str, str] = {}
    for entry in section.sections("env"):
        entry.refuse_unknown(("name", "value"))
        value = entry.get("value")
        if value is not None and value.kind in ("map", "seq"):
            raise value.fail(f"expected text, found {value.described()}")
        found[entry.required_text("name")] = "" if value is None else entry.templates.render(value, value.raw)
    try:
        return read_env(found)
    except DockerError as error:
        raise (section.get("env") or section.node).fail(str(error)) from None


def tagged(image: str) -> bool:
    """Whether a reference has a tag or a digest; a port is none."""
    return "@" in image or bool(_TAGGED.search(image))


def _image(settings: Section) -> tuple[str, tuple[str, ...]]:
    image, notes = settings.required_text("image"), []
    if not tagged(image):
        tags = settings.texts("tags")
        image = f"{image}:{tags[0] if tags else 'latest'}"
    at = settings.get("image") or settings.node
    if image.endswith(":latest"):
        notes.append(f"{at.place}: {at.path} is {image}: latest is another image tomorrow; write a tag")
    if settings.flag("load") and not settings.flag("push"):
        notes.append(f"{at.place}: {at.path} is loaded and not pushed: the nodes of a cluster cannot pull it")
    return image, tuple(notes)


def login(document: Section, image: str) -> str:
    """Server of the provider that the image comes from, when its entry has a password; the password is not read."""
    providers = document.section("providers")
    for _, node in providers.node.mapping().items() if providers else ():
        provider = document.at(node)
        provider.refuse_unknown(("provider", "with"))
        settings = provider.node.mapping().get("with")
        if settings is None or settings.kind != "map" or "password" not in settings.mapping():
            continue
        server = document.at(settings).get("server")
        host = str(server.value if server else "").removeprefix("https://").partition("/")[0]
        if host and image.startswith(f"{host}/"):
            return host
    return ""
