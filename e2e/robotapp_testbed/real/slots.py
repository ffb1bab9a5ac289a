"""Which clusters of real nodes exist on this machine: each holds a numbered lock, which ends with its last holder.

The guard inherits the lock, so a number is free only after the guard has cleaned up. A number taken from somebody whose
guard was killed as well is swept first.
"""

import fcntl
import json
import os
from pathlib import Path
from typing import TextIO

from robotapp_testbed.failures import TestbedError
from robotapp_testbed.real.config.addresses import CLUSTERS, Addresses
from robotapp_testbed.real.scripts import sweep

FOLDER = Path("/run/robotapp-nodes")
_NAMED = 3


class Slot:
    """A number nobody else on this machine has, until `release`."""

    def __init__(self, number: int, file: TextIO) -> None:
        self.addresses = Addresses(number)
        self._file = file

    @property
    def descriptor(self) -> int:
        """Given to the guard, which then holds the number as well."""
        return self._file.fileno()

    def note(self, run_dir: Path) -> None:
        """For whoever has to sweep after us."""
        self._file.seek(0)
        self._file.truncate()
        json.dump({"pid": os.getpid(), "run_dir": str(run_dir)}, self._file)
        self._file.flush()

    def release(self) -> None:
        self._file.seek(0)
        self._file.truncate()
        self._file.close()


def take(folder: Path = FOLDER, *, cgroups: Path = sweep.CGROUPS, links: Path = sweep.LINKS) -> Slot:
    """The lowest free number; what a killed holder left under it is removed first. Where that cannot be, or somebody else
    has a link or control group of that name, the next one is taken."""
    folder.mkdir(parents=True, exist_ok=True)
    foreign: list[str] = []
    for number in range(CLUSTERS):
        file = _locked(folder / f"{number}.lock")
        if file is None:
            continue
        slot = Slot(number, file)
        ours = slot.addresses
        left = _left_folder(file)
        in_the_way = sweep.sweep(
            run_dir=left,
            cgroup=ours.cgroup,
            host_link=ours.host_link,
            root=cgroups,
            links=links,
            patience_s=sweep.PATIENCE_S if left else 0,  # where nobody was killed nothing is about to go
        )
        if not in_the_way:
            return slot
        file.close()
        foreign.append(" and ".join(in_the_way))
    raise TestbedError(_none_free(foreign))


def _none_free(foreign: list[str]) -> str:
    """What keeps all numbers: clusters, and what somebody else has given one of their names."""
    running = f"{CLUSTERS - len(foreign)} clusters of real nodes run, end some with `python -m robotapp_testbed down`"
    if not foreign:
        return f"{running}; this machine can have no more"
    names = ", ".join(foreign[:_NAMED]) + (f" and {len(foreign) - _NAMED} more" if len(foreign) > _NAMED else "")
    others = f"{len(foreign)} names for clusters belong to something else, remove it: {names}"
    kept = others if len(foreign) == CLUSTERS else f"{others}; {running}"
    return f"none of the {CLUSTERS} numbers for clusters of real nodes is free: {kept}"


def in_use(folder: Path = FOLDER) -> list[int]:
    """Numbers of the clusters that run now."""
    numbers = []
    for path in folder.glob("*.lock") if folder.is_dir() else []:
        file = _locked(path)
        if file is None:
            numbers.append(int(path.stem))
        else:
            file.close()
    return sorted(numbers)


def _locked(path: Path) -> TextIO | None:
    file = path.open("a+")
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        file.close()
        return None
    return file


def _left_folder(file: TextIO) -> Path | None:
    file.seek(0)
    try:
        return Path(json.load(file)["run_dir"])
    except (ValueError, TypeError, KeyError):
        return None  # nothing in it yet, or not written to its end: a number is free all the same
