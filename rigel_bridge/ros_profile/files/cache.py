"""What was read, kept by content: a second run reads only what changed. Losing it costs time, nothing else."""

import contextlib
import hashlib
import os
import tempfile
from pathlib import Path
from typing import Final

import msgspec

from ros_profile.model.launch import LaunchFile
from ros_profile.model.package import SourceFile

MAX_BYTES: Final = 64 << 20


class Entry(msgspec.Struct, frozen=True, array_like=True):
    """What one file held: a source file or a launch file; neither when it tells nothing."""

    source: SourceFile | None = None
    launch: LaunchFile | None = None


class Shelf:
    """The entries of one package, by digest of path and bytes. `version` is a digest of our own code: with other readers
    nothing is taken over.
    """

    def __init__(self, folder: Path | None, package: str, version: str) -> None:
        name = hashlib.sha256(f"{version}\0{package}".encode()).hexdigest()[:32]
        self._file = folder / f"{name}.msgpack" if folder else None
        self._old: dict[str, Entry] = self._read()
        self._new: dict[str, Entry] = {}
        self._changed = False

    def _read(self) -> dict[str, Entry]:
        if self._file is None:
            return {}
        try:
            with self._file.open("rb") as stream:
                data = stream.read(MAX_BYTES + 1)
            return msgspec.msgpack.decode(data, type=dict[str, Entry]) if len(data) <= MAX_BYTES else {}
        except (OSError, msgspec.MsgspecError, ValueError, RecursionError):
            return {}

    def get(self, key: str) -> Entry | None:
        found = self._old.get(key)
        if found is not None:
            self._new[key] = found
        return found

    def put(self, key: str, entry: Entry) -> None:
        self._new[key] = entry
        self._changed = True

    def save(self) -> None:
        """Replace the file at once, so that two runs at a time do no harm. A full or read-only disk is no error."""
        if self._file is None or not (self._changed or len(self._new) != len(self._old)):
            return
        with contextlib.suppress(OSError):
            self._file.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            handle, name = tempfile.mkstemp(dir=self._file.parent, prefix=".new-")
            try:
                with os.fdopen(handle, "wb") as stream:
                    stream.write(msgspec.msgpack.encode(self._new))
                Path(name).replace(self._file)
            except OSError:
                Path(name).unlink()


def key_of(file: str, data: bytes) -> str:
    """The name of an entry."""
    return hashlib.blake2b(file.encode(errors="surrogateescape") + b"\0" + data, digest_size=16).hexdigest()


def code_version() -> str:
    """A digest of our own readers and types."""
    digest = hashlib.sha256()
    root = Path(__file__).resolve().parent.parent
    for file in sorted([*root.glob("read/**/*.py"), *root.glob("model/*.py"), *root.glob("files/*.py")]):
        digest.update(file.read_bytes())
    return digest.hexdigest()
