"""Run as a script: try what real nodes need from the kernel, in namespaces of its own; prints what is refused.

    python -I -S try_kernel.py EMPTY_FOLDER

Everything it makes vanishes with it, except the cgroup it makes and removes. Uses nothing of the package.
"""

import ctypes
import fcntl
import os
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

CLONE_NEWNS, CLONE_NEWUTS, CLONE_NEWIPC, CLONE_NEWPID, CLONE_NEWNET = (
    0x20000,
    0x4000000,
    0x8000000,
    0x20000000,
    0x40000000,
)
MS_REC, MS_PRIVATE = 16384, 1 << 18
TUNSETIFF, IFF_TAP, IFF_NO_PI = 0x400454CA, 2, 0x1000
V1_CONTROLLERS = ("cpu", "cpuacct", "cpuset", "memory", "devices", "freezer", "pids")
V2_CONTROLLERS = ("cpu", "cpuset", "memory", "pids")
CGROUPS = Path("/sys/fs/cgroup")
LIBC = ctypes.CDLL(None, use_errno=True)


def checked(result: int) -> None:
    if result != 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))


def namespaces(_: Path) -> None:
    checked(LIBC.unshare(CLONE_NEWNS | CLONE_NEWUTS | CLONE_NEWIPC | CLONE_NEWPID | CLONE_NEWNET))
    checked(LIBC.mount(b"none", b"/", b"none", ctypes.c_ulong(MS_REC | MS_PRIVATE), None))
    child = os.fork()  # a process namespace ends with its first process, so the other trials are all made by that one
    if child:
        sys.exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))


def overlay(folder: Path) -> None:
    for name in ("lower", "upper", "work", "merged"):
        (folder / name).mkdir()
    layers = f"lowerdir={folder}/lower,upperdir={folder}/upper,workdir={folder}/work"
    checked(LIBC.mount(b"overlay", os.fsencode(folder / "merged"), b"overlay", ctypes.c_ulong(0), layers.encode()))


def tap(_: Path) -> None:
    descriptor = os.open("/dev/net/tun", os.O_RDWR)
    fcntl.ioctl(descriptor, TUNSETIFF, struct.pack("16sH22x", b"try0", IFF_TAP | IFF_NO_PI))


def links(_: Path) -> None:
    for line in ("link add try1 type veth peer name try2", "link add try3 type bridge"):
        command("ip", *line.split())


def address_translation(_: Path) -> None:
    command("iptables", "-t", "nat", "-A", "POSTROUTING", "-m", "comment", "--comment", "try", "-j", "MASQUERADE")
    command("iptables", "-t", "nat", "-A", "OUTPUT", "-m", "statistic", "--mode", "random", "--probability", "0.5")


def controllers(_: Path) -> None:
    if (CGROUPS / "cgroup.controllers").exists():
        one_hierarchy()
    else:
        hierarchies()


def hierarchies() -> None:
    """cgroup v1, also where v2 is mounted beside it without controllers."""
    absent = [name for name in V1_CONTROLLERS if not (CGROUPS / name).is_dir()]
    if absent:
        raise OSError(f"no controller {', '.join(absent)} below {CGROUPS} (cgroup v1)")
    for name in V1_CONTROLLERS:
        folder = CGROUPS / name / f"robotapp-try-{os.getpid()}"
        folder.mkdir()
        folder.rmdir()


def one_hierarchy() -> None:
    """cgroup v2: what is handed down here stays so, as with every start, since a cluster may be about to use it."""
    offered = (CGROUPS / "cgroup.controllers").read_text().split()
    absent = [name for name in V2_CONTROLLERS if name not in offered]
    if absent:
        raise OSError(
            f"no controller {', '.join(absent)} below {CGROUPS} (cgroup v2): hierarchies of cgroup v1 hold them,"
            " or whoever started this container keeps them"
        )
    folder = CGROUPS / f"robotapp-try-{os.getpid()}"
    folder.mkdir()
    try:
        handed_down = (CGROUPS / "cgroup.subtree_control").read_text().split()
        for name in V2_CONTROLLERS:
            if name not in handed_down:
                hand_down(name)
    finally:
        folder.rmdir()


def hand_down(name: str) -> None:
    try:
        (CGROUPS / "cgroup.subtree_control").write_text(f"+{name}")
    except OSError as error:
        raise OSError(
            f"{CGROUPS} (cgroup v2) does not hand down {name} ({error.strerror}): processes live in it directly, as in"
            " a container with a cgroup namespace of its own; start it with that of the host"
        ) from error


TRIALS: tuple[tuple[str, Callable[[Path], None]], ...] = (
    ("control groups", controllers),
    ("new namespaces", namespaces),
    ("overlay file systems in the folder for temporary files (TMPDIR)", overlay),
    ("TAP devices", tap),
    ("virtual network links (veth, bridge)", links),
    ("address translation (iptables)", address_translation),
)


def command(*argv: str) -> None:
    done = subprocess.run(argv, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise OSError(done.stderr.strip().splitlines()[-1] if done.stderr.strip() else f"{argv[0]} failed")


def main() -> None:
    for name, trial in TRIALS:
        try:
            trial(Path(sys.argv[1]))
        except OSError as error:
            print(f"the kernel refuses {name}: {error.strerror or error}")
            sys.exit(1)


if __name__ == "__main__":
    main()
