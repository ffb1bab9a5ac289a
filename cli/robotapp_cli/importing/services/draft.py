"""A component that is being put together, and the names and units that its fields need."""

import posixpath
import re
from dataclasses import dataclass, field
from typing import Any, Final

from robotapp_cli.importing.files.parts import Part
from robotapp_cli.importing.files.project import Loader, Project
from robotapp_cli.importing.report import Report, Verdict
from robotapp_cli.lint.findings import shown
from robotapp_cli.lint.marks import MARK

Json = dict[str, Any]
_NO_LABEL: Final = re.compile(r"[^a-z0-9]+")
_BYTES: Final = re.compile(r"(\d+(?:\.\d+)?)\s*([bkmgt]?)(?:i?b)?", re.IGNORECASE)
_POWERS: Final = {"": 0, "b": 0, "k": 1, "m": 2, "g": 3, "t": 4}
_TIME: Final = re.compile(r"(\d+(?:\.\d+)?)(us|ms|s|m|h)")
_SECONDS: Final = {"us": 1e-6, "ms": 1e-3, "s": 1.0, "m": 60.0, "h": 3600.0}


@dataclass(slots=True)
class Context:
    """Values that all components of an import share."""

    app: str
    project: Project
    loader: Loader
    report: Report
    components: dict[str, str] = field(default_factory=dict)
    """Names of components by service."""
    objects: dict[tuple[str, str], Json] = field(default_factory=dict)
    """PersistentVolumeClaims and ConfigMaps to write beside the RobotApp, by kind and name."""


@dataclass(slots=True)
class Draft:
    """The fields of one component, filled by one handler per field of the service."""

    name: str
    service: Part
    context: Context
    fields: Json = field(default_factory=dict)
    pod: Json = field(default_factory=dict)
    """Fields of template.spec."""
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    env: dict[str, Part] = field(default_factory=dict)
    """Environment variables; those of `environment` replace those of `env_file`."""
    ros: dict[str, Part] = field(default_factory=dict)
    """Variables that become fields of the app."""
    places: dict[str, Part] = field(default_factory=dict)
    """Where the volumes of the component are written in the file, by their path in the container."""
    distro: str = ""
    is_without_ros: bool = False

    @property
    def report(self) -> Report:
        return self.context.report

    @property
    def is_on_host_network(self) -> bool:
        mode = self.service.get("network_mode")
        return mode is not None and mode.as_text() == "host"

    def secure(self, name: str, value: Any) -> None:
        """Sets an option of the container's securityContext."""
        self.fields.setdefault("securityContext", {})[name] = value

    def limit(self, kind: str, name: str, value: str | int) -> None:
        """Sets a request or a limit."""
        self.fields.setdefault("resources", {}).setdefault(kind, {})[name] = value

    def mount(self, volume: Json, mount: Json, item: Part) -> None:
        """Adds a volume and its place in the container, where a later item replaces an earlier one.

        A volume that the pod has already is used again, but no empty folder: each has a content of its own.
        """
        mounts = self.fields.setdefault("volumeMounts", [])
        path = posixpath.normpath(mount["mountPath"])
        if MARK not in path:
            self._replace_mount(path, item)
        volumes = self.pod.setdefault("volumes", [])
        source = {key: value for key, value in volume.items() if key != "name"}
        same = next((other["name"] for other in volumes if {**other, "name": ""} == {**source, "name": ""}), None)
        if same is None or "emptyDir" in source:
            names = [other["name"] for other in volumes]
            same = make_unique(volume["name"], names)
            volumes.append({"name": same, **source})
        mounts.append({"name": same, **mount})

    def _replace_mount(self, path: str, item: Part) -> None:
        """Takes away what is mounted at the path already: a container has one mount of a path."""
        earlier = self.places.get(path)
        self.places[path] = item
        if earlier is None:
            return
        mounts, volumes = self.fields["volumeMounts"], self.pod["volumes"]
        mounts[:] = [other for other in mounts if posixpath.normpath(other["mountPath"]) != path]
        names = {other["name"] for other in mounts}
        volumes[:] = [other for other in volumes if other["name"] in names]
        text = f"{shown(item.path)} is mounted at {path}, too, and the later one wins; give one of them another path"
        self.report.replace(earlier, Verdict.LEFT_OUT, text)

    def assemble(self) -> Json:
        """Returns the component as the API has it."""
        order = ("name", "image", "ros", "command", "args", "workingDir", "env", "ports", "resources")
        fields = {"name": self.name, **{key: self.fields[key] for key in order if key in self.fields}}
        fields |= {key: value for key, value in self.fields.items() if key not in fields}
        template: Json = {}
        if self.metadata:
            template["metadata"] = self.metadata
        if self.pod:
            template["spec"] = self.pod
        return {**fields, "template": template} if template else fields


def make_label(text: str, *, most: int = 63, instead: str = "app") -> str:
    """Returns a DNS label that is as similar to the text as possible.

    >>> make_label("My_Robot.1")
    'my-robot-1'
    """
    return _NO_LABEL.sub("-", text.lower()).strip("-")[:most].strip("-") or instead


def make_unique(name: str, others: list[str], *, most: int = 63) -> str:
    """Returns the name, with a number behind it where another thing has it already."""
    candidate, number = name, 1
    while candidate in others:
        number += 1
        suffix = f"-{number}"
        candidate = name[: most - len(suffix)].rstrip("-") + suffix
    return candidate


def escape_references(text: str) -> str:
    """Returns the text so that Kubernetes, which replaces $(NAME), hands it over as it is.

    >>> escape_references("echo $(hostname) $HOME")
    'echo $$(hostname) $HOME'
    """
    return re.sub(r"\$(?=[$(])", "$$", text)


def read_bytes(part: Part) -> int:
    """Returns a size such as 512m or 1gb in bytes; compose counts in powers of 1024."""
    match = _BYTES.fullmatch(part.as_text().strip())
    if match is None:
        raise part.fail(f"{part.as_text()[:40]!r} is no size; write a number and a unit, such as 512m or 1gb")
    return int(float(match[1]) * 1024 ** _POWERS[match[2].lower()])


def format_bytes(count: int) -> str:
    """Returns a quantity of Kubernetes.

    >>> format_bytes(1 << 30), format_bytes(1000)
    ('1Gi', '1000')
    """
    for power, unit in ((3, "Gi"), (2, "Mi"), (1, "Ki")):
        if count and count % 1024**power == 0:
            return f"{count // 1024**power}{unit}"
    return str(count)


def read_seconds(part: Part) -> float:
    """Returns a duration such as 1m30s in seconds; a number alone counts seconds."""
    text = part.as_text().strip()
    if text.replace(".", "", 1).isdigit() and text.isascii():
        return float(text)
    if not text or _TIME.sub("", text):
        raise part.fail(f"{text[:40]!r} is no duration; write numbers with units, such as 10s or 1m30s")
    return sum(float(number) * _SECONDS[unit] for number, unit in _TIME.findall(text))


def report_fields(draft: Draft, part: Part, handled: frozenset[str], reasons: dict[str, str] | None = None) -> None:
    """Reports the fields of a mapping that no handler has taken."""
    for name, inner in (part.fields or {}).items():
        if name in handled:
            continue
        text = (reasons or {}).get(name) or (
            "an extension of compose, which nothing in a cluster reads"
            if name.startswith("x-")
            else f"{name} is no field that an import acts on; correct the name, or leave it out"
        )
        draft.report.omit(inner, text)
