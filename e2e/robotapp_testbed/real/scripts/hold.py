"""Run as a script: make a set of namespaces and keep them until killed.

    python -I -S hold.py PLAN.json

PLAN.json: {"hostname", "pid_file", "mounts": [{"kind": "bind"|"overlay", "source", "target", "upper", "work"}],
"pretended": {file of /proc/sys: text}, "sysctls": {file of /proc/sys: text}}.

The script makes new network, mount, host name, IPC and process namespaces and forks their first process, whose pid (as
the host sees it) it writes to `pid_file` when all is set up. The first process collects orphans. It dies with the script,
and everything in the namespaces with it: processes, then mounts and links. Uses nothing of the package.
"""

import ctypes
import json
import os
import select
import signal
import socket
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

CLONE_NEWNS, CLONE_NEWUTS, CLONE_NEWIPC, CLONE_NEWPID, CLONE_NEWNET = (
    0x20000,
    0x4000000,
    0x8000000,
    0x20000000,
    0x40000000,
)
MS_NOSUID, MS_NODEV, MS_NOEXEC, MS_BIND, MS_REC, MS_SLAVE, MS_SHARED = 2, 4, 8, 4096, 16384, 1 << 19, 1 << 20
PR_SET_PDEATHSIG = 1
LIBC = ctypes.CDLL(None, use_errno=True)


def checked(result: int, what: str) -> None:
    if result != 0:
        number = ctypes.get_errno()
        raise OSError(number, f"{what}: {os.strerror(number)}")


def mount(source: str, target: str | Path, kind: str, flags: int, data: str = "") -> None:
    arguments = [os.fsencode(str(part)) for part in (source, target, kind)]
    checked(LIBC.mount(*arguments, ctypes.c_ulong(flags), os.fsencode(data)), f"mount {kind} {source} on {target}")


def make_place(target: Path, *, folder: bool) -> None:
    """What is mounted on must exist: in an overlay or in the run folder, never on the host."""
    target.parent.mkdir(parents=True, exist_ok=True)
    if folder:
        target.mkdir(exist_ok=True)
    else:
        target.touch()


def set_up(plan: dict[str, Any]) -> None:
    mount("none", "/", "none", MS_REC | MS_SLAVE)  # the host's unmounts reach us, nothing of ours reaches the host
    mount("proc", "/proc", "proc", MS_NOSUID | MS_NODEV | MS_NOEXEC)
    for each in plan["mounts"]:
        if each["kind"] == "overlay":
            layers = f"lowerdir={each['source']},upperdir={each['upper']},workdir={each['work']}"
            mount("overlay", each["target"], "overlay", 0, layers)
        else:
            make_place(Path(each["target"]), folder=Path(each["source"]).is_dir())
            mount(each["source"], each["target"], "none", MS_BIND | MS_REC)
    for name, source in plan["pretended"].items():
        target = Path("/proc/sys", name)
        if target.exists():
            mount(source, target, "none", MS_BIND)
    for name, text in plan["sysctls"].items():
        with suppress(FileNotFoundError):  # of a module that is not loaded
            Path("/proc/sys", name).write_text(text)
    mount("none", "/", "none", MS_REC | MS_SHARED)  # containers that ask for it share mounts with their node
    socket.sethostname(plan["hostname"])


def first_process(plan: dict[str, Any], told: int, alive: int) -> None:
    """Process 1 of the new namespaces: set them up, then collect whatever loses its parent."""
    checked(LIBC.prctl(PR_SET_PDEATHSIG, signal.SIGKILL), "prctl")
    if select.select([alive], [], [], 0)[0]:  # the other end closed: the script died before the line above
        os._exit(1)
    set_up(plan)
    os.write(told, b"1")
    os.close(told)
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGCHLD})
    while True:
        with suppress(ChildProcessError):
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass
        signal.sigwait({signal.SIGCHLD})


def main() -> None:
    plan = json.loads(Path(sys.argv[1]).read_text())
    checked(LIBC.unshare(CLONE_NEWNS | CLONE_NEWUTS | CLONE_NEWIPC | CLONE_NEWPID | CLONE_NEWNET), "unshare")
    told, tell = os.pipe()
    alive, life = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(told)
        os.close(life)
        first_process(plan, tell, alive)
    os.close(tell)
    os.close(alive)
    if os.read(told, 1):
        partial = Path(f"{plan['pid_file']}.partial")
        partial.write_text(str(child))
        partial.replace(plan["pid_file"])
    _, status = os.waitpid(child, 0)
    sys.exit(os.waitstatus_to_exitcode(status) or 1)


if __name__ == "__main__":
    main()
