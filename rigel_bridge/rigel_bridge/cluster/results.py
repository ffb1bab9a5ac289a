"""Collect what an app shows of itself into a folder: its state, logs, and the result files of its containers."""

import errno
import hashlib
import io
import json
import tarfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any, Final

from rigel_bridge.cluster.instances import instances_of, is_ready, pods_of
from rigel_bridge.cluster.kubectl import ClusterError, Kubectl
from rigel_bridge.document.failures import BridgeError, Exit, Place
from rigel_bridge.names import COMPONENT_LABEL, INSTANCE_LABEL, PROVENANCE

MANIFEST: Final = "manifest.json"
APP: Final = "app.json"
"""Written first of all."""
FILES: Final = "files"
"""Folder of what containers left, by component."""
RESULTS_PATH: Final = f"{PROVENANCE}results-path"
_LOG_BYTES: Final = 1024 * 1024
_FILES_BYTES: Final = 256 * 1024 * 1024
_COPY_S: Final = 300.0
_SHOWN: Final = 200
MAX_FILES: Final = 10_000
"""Of one archive."""
_NAME_ERRORS: Final = (errno.ENAMETOOLONG, errno.ENOTDIR, errno.EISDIR, errno.EEXIST, errno.EILSEQ)


@dataclass(slots=True)
class Collection:
    """A folder that is being filled. Its manifest names every file with its SHA-256."""

    folder: Path
    sums: dict[str, str] = field(default_factory=dict)

    def add(self, name: PurePosixPath | str, content: bytes) -> None:
        path = self.folder / name
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        except OSError as error:
            raise _unwritable(path, error) from error
        self.sums[str(name)] = hashlib.sha256(content).hexdigest()

    def add_json(self, name: str, value: Any) -> None:
        self.add(name, json.dumps(value, indent=2, sort_keys=True).encode())

    def close(self) -> None:
        """Write the manifest, last: a folder without one is not complete."""
        text = json.dumps({"sha256": dict(sorted(self.sums.items()))}, indent=2)
        try:
            (self.folder / MANIFEST).write_text(text)
        except OSError as error:
            raise _unwritable(self.folder / MANIFEST, error) from error


def opened(folder: Path) -> Collection:
    """A collection in a folder that is new or empty: results of another run are never mixed in."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            raise BridgeError(Place(str(folder)), "is not empty: name a new folder, results are never overwritten")
    except OSError as error:
        raise _unwritable(folder, error) from error
    return Collection(folder)


def collect(
    kubectl: Kubectl, app: Mapping[str, Any], into: Collection, *, tell: Callable[[str], None], path: str = ""
) -> None:
    """State, logs and result files. What cannot be had (a log, a file) is told and left out.

    `path`: where the containers keep their results; default is the app's annotation, from `results.source_path`.
    """
    into.add_json(APP, app)
    into.add_json("instances.json", instances_of(kubectl, app))
    source = path or (app["metadata"].get("annotations") or {}).get(RESULTS_PATH, "")
    try:
        pods = pods_of(kubectl, app)
    except ClusterError as error:
        tell(f"no pods, logs and result files: {error}")
        return
    into.add_json("pods.json", pods)
    for pod in pods:
        _logs(kubectl, pod, into, tell)
    for component, pod in newest(pods).items() if source else ():
        _files(kubectl, pod, into, where=PurePosixPath(FILES) / component, source=source, tell=tell)


def newest(pods: list[dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """The newest ready pod of each component and instance, by the name of its folder."""
    found: dict[str, dict[str, Any]] = {}
    for pod in sorted(pods, key=lambda pod: str(pod["metadata"].get("creationTimestamp", ""))):
        labels = pod["metadata"].get("labels", {})
        if COMPONENT_LABEL in labels and is_ready(pod):
            instance = labels.get(INSTANCE_LABEL, "")
            found["-".join(part for part in (instance, labels[COMPONENT_LABEL]) if part)] = pod
    return found


def _logs(kubectl: Kubectl, pod: Mapping[str, Any], into: Collection, tell: Callable[[str], None]) -> None:
    name = pod["metadata"]["name"]
    for container in pod["spec"]["containers"]:
        wanted = ("logs", name, "-c", container["name"], f"--limit-bytes={_LOG_BYTES}")
        try:
            content = kubectl.binary(*wanted, limit=2 * _LOG_BYTES)
        except ClusterError as error:
            tell(f"no log of {name}: {error}")
        else:
            into.add(f"logs/{name}.{container['name']}.log", content)


def _files(
    kubectl: Kubectl,
    pod: Mapping[str, Any],
    into: Collection,
    *,
    where: PurePosixPath,
    source: str,
    tell: Callable[[str], None],
) -> None:
    name = pod["metadata"]["name"]
    try:
        data = kubectl.binary(
            "exec", name, "--", "tar", "-cf", "-", "-C", source, ".", limit=_FILES_BYTES, timeout_s=_COPY_S
        )
        for path, content in files_of(data):
            _add_named_by_container(into, where / path, content, tell)
    except (ClusterError, ArchiveError) as error:
        tell(f"no result files of {name} from {source}: {error}")


def _add_named_by_container(into: Collection, path: PurePosixPath, content: bytes, tell: Callable[[str], None]) -> None:
    """A file whose name no file here can have (too long, or below another file) is left out; a full disk is an error."""
    try:
        into.add(path, content)
    except BridgeError as error:
        if not isinstance(error.__cause__, OSError) or error.__cause__.errno not in _NAME_ERRORS:
            raise
        tell(f"{str(path)[:_SHOWN]} is left out: {error.__cause__.strerror}")


def _unwritable(path: Path, error: OSError) -> BridgeError:
    return BridgeError(Place(str(path)), f"cannot be written: {error.strerror}", code=Exit.UNREADABLE)


class ArchiveError(Exception):
    """Why an archive is not taken."""


def files_of(data: bytes) -> Iterator[tuple[PurePosixPath, bytes]]:
    """Relative path and content of the ordinary files; links, devices and paths that lead out of the folder are passed over.

    A container can write any archive: a sparse file of a few bytes stands for terabytes, a size can be larger than any memory
    address, and headers can follow headers until Python's stack ends. All that is an ArchiveError.
    """
    left = len(data)
    try:
        with tarfile.open(fileobj=io.BytesIO(data), mode="r:") as archive:
            for count, member in enumerate(archive):
                if count >= MAX_FILES:
                    raise ArchiveError(f"has more than {MAX_FILES} files")
                if not member.isreg() or not _is_inside(member.name):
                    continue
                left -= max(member.size, 0)
                if left < 0:
                    raise ArchiveError(f"is no archive: the files are larger than its {len(data)} bytes")
                content = archive.extractfile(member)
                if content is not None:
                    yield PurePosixPath(member.name), content.read()
    except (tarfile.TarError, EOFError, ValueError, ArithmeticError, LookupError, RecursionError) as error:
        raise ArchiveError(f"is no archive: {error}") from error


def _is_inside(name: str) -> bool:
    path = PurePosixPath(name)
    return bool(path.parts) and not path.is_absolute() and ".." not in path.parts and "\0" not in name
