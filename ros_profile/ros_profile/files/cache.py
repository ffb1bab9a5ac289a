"""What was read, kept by content: a second run reads only what changed. Losing it costs time, nothing else."""

import contextlib
import hashlib
import os
import stat
import tempfile
from pathlib import Path
from typing import Final, TypeVar

import msgspec

from ros_profile.model.conclusions import Profile
from ros_profile.model.launch import LaunchFile
from ros_profile.model.package import SourceFile

MAX_BYTES: Final = 64 << 20
_WRITABLE: Final = stat.S_IWGRP | stat.S_IWOTH


class Entry(msgspec.Struct, frozen=True, array_like=True):
    """What one file held: a source file or a launch file; neither when nothing of it is used."""

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
        self.digest = hashlib.blake2b(digest_size=16)
        """Of everything of the package that was looked up, in order."""
        self._changed = False

    def _read(self) -> dict[str, Entry]:
        found = _read(self._file, dict[str, Entry])
        return found or {}

    def get(self, key: str) -> Entry | None:
        self.digest.update(key.encode())
        found = self._old.get(key)
        if found is not None:
            self._new[key] = found
        return found

    def put(self, key: str, entry: Entry) -> None:
        self._new[key] = entry
        self._changed = True

    def save(self) -> None:
        """Write what this run used, when that is not what stood there."""
        if self._file is None or not (self._changed or len(self._new) != len(self._old)):
            return
        _write(self._file, self._new)


class _Kept(msgspec.Struct, frozen=True, array_like=True):
    digest: str
    profile: Profile


class LastProfile:
    """The last profile of a folder with these settings, good as long as nothing of what was read has changed."""

    def __init__(self, folder: Path | None, *settings: str) -> None:
        name = hashlib.sha256("\0".join(settings).encode(errors="surrogateescape")).hexdigest()[:32]
        self._file = folder / f"{name}.profile" if folder else None

    def get(self, digest: str) -> Profile | None:
        kept = _read(self._file, _Kept)
        return kept.profile if kept is not None and kept.digest == digest else None

    def put(self, digest: str, profile: Profile) -> None:
        if self._file is not None:
            _write(self._file, _Kept(digest, profile))


T = TypeVar("T")


def _read(file: Path | None, kind: type[T]) -> T | None:
    """What a file holds; None when it is missing, damaged, too large, or of another user, who could write any profile into it."""
    if file is None:
        return None
    try:
        descriptor = os.open(file, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
        with os.fdopen(descriptor, "rb") as stream:
            status = os.fstat(descriptor)
            if not stat.S_ISREG(status.st_mode) or status.st_uid != os.geteuid() or status.st_mode & _WRITABLE:
                return None
            data = stream.read(MAX_BYTES + 1)
        return msgspec.msgpack.decode(data, type=kind) if len(data) <= MAX_BYTES else None
    except (OSError, msgspec.MsgspecError, ValueError, RecursionError):
        return None


def _write(file: Path, value: object) -> None:
    """Replace the file at once, so that two runs at a time do no harm. A full or read-only disk is no error."""
    with contextlib.suppress(OSError):
        file.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        handle, name = tempfile.mkstemp(dir=file.parent, prefix=".new-")
        try:
            with os.fdopen(handle, "wb") as stream:
                stream.write(msgspec.msgpack.encode(value))
            Path(name).replace(file)
        except OSError:
            Path(name).unlink()


def key_of(file: str, data: bytes) -> str:
    """The name of an entry."""
    return hashlib.blake2b(file.encode(errors="surrogateescape") + b"\0" + data, digest_size=16).hexdigest()


def code_version() -> str:
    """A digest of our own code: with another version nothing is taken over."""
    digest = hashlib.sha256()
    for file in sorted(Path(__file__).resolve().parent.parent.glob("**/*.py")):
        digest.update(file.read_bytes())
    return digest.hexdigest()
