"""The cache outside the repository: where finished binaries live, and how two callers share it.

A binary is written under another name and renamed; its size is recorded beside it last. One that lacks this record, or has
another size, was cut short (a crash, a full disk, a copied folder) and is made again. One lock file per binary makes the
second caller wait for the first instead of doing the work twice.
"""

import fcntl
import hashlib
import os
import shutil
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from robotapp_testbed.binaries import pins

_LOCK_POLL_S = 0.2


def cache_home(env: Mapping[str, str] = os.environ) -> Path:
    """`$XDG_CACHE_HOME/robotapp` or `~/.cache/robotapp`."""
    base = env.get("XDG_CACHE_HOME", "")
    if not Path(base).is_absolute():  # the specification tells to ignore relative paths
        base = str(Path(env["HOME"]) / ".cache") if env.get("HOME") else str(Path.home() / ".cache")
    return Path(base) / "robotapp"


def module_key(*, module_dir: Path = pins.MODULE_DIR, ldflags: str = pins.LDFLAGS) -> str:
    """Hash of everything a compiled binary depends on.

    The version of Go is left out: the modules fix what the program does, and one that another Go compiled serves as well.
    """
    digest = hashlib.sha256()
    modules = [(module_dir / name).read_bytes() for name in ("go.mod", "go.sum")]
    for part in (*modules, pins.build_settings(ldflags).encode()):
        digest.update(hashlib.sha256(part).digest())
    return digest.hexdigest()[:16]


def release_key() -> str:
    """Hash of the pinned versions of the official releases, and of the machine they are for."""
    releases = tuple((binary.name, binary.release) for binary in pins.BINARIES)
    return hashlib.sha256(repr((releases, pins.platform_names())).encode()).hexdigest()[:16]


@dataclass(frozen=True, slots=True)
class Store:
    """One folder of finished binaries."""

    directory: Path

    def path(self, name: str) -> Path:
        return self.directory / name

    def get(self, name: str) -> Path | None:
        """The binary, when it is there, whole and executable."""
        path = self.path(name)
        try:
            whole = path.is_file() and path.stat().st_size == int(self._record(name).read_text())
        except (OSError, ValueError):
            return None
        return path if whole and os.access(path, os.X_OK) else None

    def _record(self, name: str) -> Path:
        return self.directory / f".{name}.size"

    def _finish(self, partial: Path, name: str) -> None:
        with partial.open("rb") as file:
            os.fsync(file.fileno())  # else a crash of the machine could leave the name and the size without the content
            size_bytes = os.fstat(file.fileno()).st_size
        partial.chmod(0o755)
        partial.replace(self.path(name))
        self._record(name).write_text(str(size_bytes))

    @contextmanager
    def adding(self, name: str, *, on_wait: Callable[[], None] = lambda: None) -> Iterator[Path | None]:
        """Hold the binary's lock; yields where to write it, or None when another caller finished it meanwhile.

        On success the file written there becomes the binary, atomically; otherwise nothing of it is left.
        """
        self.directory.mkdir(parents=True, exist_ok=True)
        with locked(self.directory / f".{name}.lock", on_wait=on_wait):
            if self.get(name):
                yield None
                return
            for left in self.directory.glob(f".{name}.*.partial*"):  # of callers that were killed
                shutil.rmtree(left) if left.is_dir() else left.unlink()
            partial = self.directory / f".{name}.{os.getpid()}.partial"
            try:
                yield partial
                if partial.is_file():
                    self._finish(partial, name)
            finally:
                partial.unlink(missing_ok=True)


@contextmanager
def locked(path: Path, *, on_wait: Callable[[], None] = lambda: None) -> Iterator[None]:
    """An exclusive lock that ends with its holder, also when that one is killed. `on_wait` is called once if it is taken."""
    with path.open("w") as file:
        waited = False
        while True:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if not waited:
                    waited = True
                    on_wait()
                time.sleep(_LOCK_POLL_S)
        yield


def built_store(*, home: Path | None = None, module_dir: Path = pins.MODULE_DIR, ldflags: str = pins.LDFLAGS) -> Store:
    key = module_key(module_dir=module_dir, ldflags=ldflags)
    return Store((home or cache_home()) / "controlplane" / f"built-{key}")


def release_store(*, home: Path | None = None) -> Store:
    return Store((home or cache_home()) / "controlplane" / f"release-{release_key()}")
