"""cgroup v2 as far as any machine has it: kubelets can only use it where no hierarchy of cgroup v1 holds the controllers."""

import subprocess
import sys

import pytest

from robotapp_testbed.real.scripts import try_kernel

pytestmark = [pytest.mark.live, pytest.mark.usefixtures("real_machine")]

_CREATE = """
import sys
from pathlib import Path
from robotapp_testbed.real import cgroups
from robotapp_testbed.real.scripts import sweep
root = Path("/sys/fs/cgroup")
handed_down = (root / "cgroup.subtree_control").read_text().split()
cgroups.create("robotapp-try-v2/edge-1", root=root)
print((root / "robotapp-try-v2/edge-1/cgroup.controllers").read_text(), end="")
left = sweep.remove_cgroups("robotapp-try-v2", root=root)
for name in set((root / "cgroup.subtree_control").read_text().split()) - set(handed_down):
    (root / "cgroup.subtree_control").write_text(f"-{name}")
sys.exit(f"{left} stayed" if left else 0)
"""


def run(*command: str) -> subprocess.CompletedProcess[str]:
    """Where /sys/fs/cgroup is the hierarchy of cgroup v2 and nothing else."""
    line = 'mount -t cgroup2 none /sys/fs/cgroup && exec "$@"'
    argv = ["unshare", "--mount", "sh", "-c", line, "sh", *command]
    return subprocess.run(argv, capture_output=True, text=True, check=False, timeout=180)


def offered() -> list[str]:
    return run("cat", "/sys/fs/cgroup/cgroup.controllers").stdout.split()


def test_the_doctor_names_the_controllers_that_cgroup_v1_holds() -> None:
    done = run(sys.executable, "-m", "robotapp_testbed", "doctor")
    absent = [name for name in try_kernel.V2_CONTROLLERS if name not in offered()]
    assert done.returncode == bool(absent), done.stdout
    if absent:
        said = done.stdout.splitlines()[-1]
        assert said.startswith("real nodes cannot run here: the kernel refuses control groups: no controller")
        assert f" {', '.join(absent)} below /sys/fs/cgroup (cgroup v2)" in said


def test_a_nodes_group_gets_what_the_kernel_offers_and_goes_again() -> None:
    done = run(sys.executable, "-c", _CREATE)
    assert done.returncode == 0, done.stderr
    wanted = {"cpu", "cpuset", "hugetlb", "io", "memory", "pids"}
    assert set(done.stdout.split()) == wanted & set(offered())
