"""Run as a script: run a program in the namespaces of another process, and end it with this script.

    python -I -S enter.py PID PROGRAM [ARGUMENT…]

Signals sent to the script are passed on to the program; the script ends with the program's status. `nsenter` does not do:
a program that it started in another process namespace survives it. Uses nothing of the package.
"""

import ctypes
import os
import select
import signal
import sys

KINDS = ("net", "uts", "ipc", "pid", "mnt")  # mnt last: after it /proc is the other one's
PASSED_ON = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGCONT)
PR_SET_PDEATHSIG = 1
LIBC = ctypes.CDLL(None, use_errno=True)


def join(pid: int) -> None:
    descriptors = [os.open(f"/proc/{pid}/ns/{kind}", os.O_RDONLY | os.O_CLOEXEC) for kind in KINDS]
    for descriptor in descriptors:
        if LIBC.setns(descriptor, 0) != 0:
            number = ctypes.get_errno()
            raise OSError(number, f"setns: {os.strerror(number)}")
        os.close(descriptor)


def become(program: list[str], alive: int) -> None:
    LIBC.prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if select.select([alive], [], [], 0)[0]:  # the script died before the line above
        os._exit(1)
    os.execv(program[0], program)  # noqa: S606 - becoming the program is the purpose


def main() -> None:
    join(int(sys.argv[1]))
    os.chdir("/")
    alive, life = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(life)
        become(sys.argv[2:], alive)
    for number in PASSED_ON:
        signal.signal(number, lambda received, _: os.kill(child, received))
    _, status = os.waitpid(child, 0)
    code = os.waitstatus_to_exitcode(status)
    sys.exit(code if code >= 0 else 128 - code)  # as a shell says that signal N ended it


if __name__ == "__main__":
    main()
