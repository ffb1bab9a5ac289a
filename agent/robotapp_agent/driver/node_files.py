"""Files of the node that the driver reads and writes: checkpoint, CDI specs, device files. Writes are whole or not at all."""

import json
import os
import stat
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path, PurePosixPath
from typing import Any, Final

import msgspec

from robotapp_agent.driver.rules.cdi_spec import DeviceFile
from robotapp_agent.driver.rules.ledger import VERSION, Ledger
from robotapp_claims.rules.device_attributes import DRIVER

MOST_BYTES: Final = 4 << 20
"""Of a checkpoint; 128 devices need less than 64 KiB."""
_MOST_LINKS: Final = 8
_TERMINAL_MAJORS: Final = range(136, 144)
"""Of pseudo-terminals, Unix98's /dev/pts."""
_MEMORY_MAJOR: Final = 1
"""Of /dev/null, /dev/zero and the like."""


class CheckpointError(Exception):
    """The checkpoint cannot be used; the text names the cure."""


class Checkpoint:
    """The ledger on the disk, so that a driver that starts again refuses what the one before it had given away."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / "checkpoint.json"

    def __repr__(self) -> str:
        return f"Checkpoint({self.path})"

    def load(self) -> Ledger:
        """The ledger, an empty one where there was none. Raises CheckpointError."""
        try:
            with self.path.open("rb") as file:
                ledger = msgspec.json.decode(file.read(MOST_BYTES + 1), type=Ledger)
        except FileNotFoundError:
            return Ledger()
        except (OSError, msgspec.DecodeError) as error:
            raise CheckpointError(self._explain(str(error))) from error
        if ledger.version != VERSION:
            raise CheckpointError(self._explain(f"it is of version {ledger.version}, this driver writes {VERSION}"))
        return ledger

    def save(self, ledger: Ledger) -> None:
        """Returns when the ledger is on the disk. Raises OSError, and then the ledger before it still counts."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        write_file(self.path, msgspec.json.encode(ledger))

    def _explain(self, problem: str) -> str:
        return (
            f"{self.path}, which holds the devices that containers of this node have, cannot be used: {problem}. Remove it when no "
            "pod of the node uses a device any more, or after a reboot"
        )


class CdiFolder:
    """CDI specs, one file per claim, in a folder that the container runtime reads."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __repr__(self) -> str:
        return f"CdiFolder({self.folder})"

    def write(self, uid: str, spec: Mapping[str, Any]) -> bool:
        """Writes the spec; returns whether it was another one. Raises OSError."""
        content = json.dumps(spec, indent=1, sort_keys=True).encode()
        path = self._path(uid)
        with suppress(OSError):
            if path.read_bytes() == content:
                return False
        self.folder.mkdir(parents=True, exist_ok=True)
        write_file(path, content, mode=0o644)
        return True

    def remove(self, uid: str) -> None:
        """Raises OSError for anything but a file that is gone already."""
        self._path(uid).unlink(missing_ok=True)

    def list_uids(self) -> list[str]:
        """The claims that have a file."""
        return sorted(path.stem.removeprefix(f"{DRIVER}-") for path in self.folder.glob(f"{DRIVER}-*.json"))

    def _path(self, uid: str) -> Path:
        return self.folder / f"{DRIVER}-{uid}.json"


def write_file(path: Path, content: bytes, *, mode: int = 0o600) -> None:
    """Replaces a file so that after a crash it has either its old or its new content, whole."""
    draft = path.with_name(f".{path.name}.draft")
    draft.unlink(missing_ok=True)
    descriptor = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, mode)
    with os.fdopen(descriptor, "wb") as file:
        file.write(content)
        file.flush()
        os.fsync(descriptor)
    draft.replace(path)
    folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(folder)  # the new name, too, is on the disk
    finally:
        os.close(folder)


class DeviceFiles:
    """Device files of the host, whose root is mounted at `host_root`. They are looked at, never opened."""

    def __init__(self, host_root: Path) -> None:
        self._root = host_root

    def __repr__(self) -> str:
        return f"DeviceFiles({self._root})"

    def find(self, path: str) -> DeviceFile | None:
        """The device file at this path of the host, symbolic links resolved; None for anything that is no device file."""
        for _ in range(_MOST_LINKS):
            place = self._root / path.lstrip("/")
            try:
                state = place.lstat()
                if stat.S_ISLNK(state.st_mode):
                    # An absolute link means the host's root, which is not ours.
                    path = os.path.normpath(PurePosixPath(path).parent / place.readlink())
                    continue
            except OSError:
                return None
            if not (stat.S_ISCHR(state.st_mode) or stat.S_ISBLK(state.st_mode)):
                return None
            major = os.major(state.st_rdev)
            number = 0 if major == _MEMORY_MAJOR else state.st_rdev
            return DeviceFile(path, terminal=major in _TERMINAL_MAJORS, gid=state.st_gid, number=number)
        return None

    def list_sound(self) -> list[str]:
        """Names below /dev/snd."""
        try:
            return sorted(path.name for path in (self._root / "dev/snd").iterdir())
        except OSError:
            return []


def read_boot_id() -> str:
    """Differs after every boot of the machine. Raises OSError."""
    return Path("/proc/sys/kernel/random/boot_id").read_text().strip()
