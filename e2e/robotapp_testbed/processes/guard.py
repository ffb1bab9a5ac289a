"""Run as a script: when the owner is gone, however it went, kill what it had started and remove its folder.

    python -I -S guard.py OWNER_PID RUN_DIR [SCRIPT ARGUMENT…]

RUN_DIR/processes holds one file per process, named by its pid, written by launch.py before the program starts.
Becomes SCRIPT at the end, for what else has to be removed. Uses nothing of the package: it must survive anything that
happens to its owner.
"""

import os
import select
import shutil
import signal
import sys
import time
from contextlib import suppress
from pathlib import Path

REGISTER = "processes"
ATTEMPTS = 100
PAUSE_S = 0.05


def start_time(pid: int) -> str | None:
    """As in launch.py (both are scripts on their own); None when there is no such process or it is a zombie."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except (FileNotFoundError, ProcessLookupError):
        return None
    return None if fields[0] == "Z" else fields[19]


def wait_for_end(pid: int) -> None:
    try:
        descriptor = os.pidfd_open(pid)
    except ProcessLookupError:
        return
    if os.getppid() == pid:  # else the pid is already someone else's
        select.select([descriptor], [], [])
    os.close(descriptor)


def kill_registered(register: Path) -> int:
    """Number of processes that were still there."""
    found = 0
    for entry in list(register.iterdir()) if register.is_dir() else []:
        pid = int(entry.name)
        if start_time(pid) == entry.read_text():
            found += 1
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
    return found


def main() -> None:
    owner, directory = int(sys.argv[1]), Path(sys.argv[2])
    wait_for_end(owner)
    for _ in range(ATTEMPTS):
        if not kill_registered(directory / REGISTER):
            break
        time.sleep(PAUSE_S)
    shutil.rmtree(directory, ignore_errors=True)
    if sys.argv[3:]:
        os.execv(sys.executable, [sys.executable, "-I", "-S", *sys.argv[3:]])  # noqa: S606 - a script of ours


if __name__ == "__main__":
    main()
