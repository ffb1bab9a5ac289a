"""Run as a script: become the wanted program, after making sure it cannot outlive the process that asked for it.

    python -I -S launch.py OWNER_PID REGISTER_DIR|- PROGRAM [ARGUMENT…]

Two safeguards, because each has a gap. Linux kills the program when the owner's spawning thread ends, however it
ends. And the program is written to REGISTER_DIR, where the guard of the control plane finds it. Uses nothing of the package: it
must start in milliseconds and run isolated.
"""

import ctypes
import os
import signal
import sys
from pathlib import Path

PR_SET_PDEATHSIG = 1


def start_time(pid: int) -> str:
    """Clock ticks since boot when the process started: with the pid it names a process for ever (proc(5), field 22)."""
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[19]


def main() -> None:
    owner, register, argv = int(sys.argv[1]), sys.argv[2], sys.argv[3:]
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if register != "-":
        Path(register, str(os.getpid())).write_text(start_time(os.getpid()))
    if os.getppid() != owner:  # the owner died before the two lines above: nobody would end us
        sys.exit("the process that asked for this program is gone")
    try:
        os.execv(argv[0], argv)  # noqa: S606 - becoming the program is the purpose
    except OSError as error:
        sys.exit(
            f"{argv[0]} cannot be run ({error.strerror}): if it is damaged or of another machine, remove it and start again"
        )


if __name__ == "__main__":
    main()
