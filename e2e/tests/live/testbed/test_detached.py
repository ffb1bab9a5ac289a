"""`up`, `env`, `status`, `down` as a person uses them."""

import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from e2e.tests.live.testbed.reader import DOWN, EXAMPLES, Reader, Shell

from robotapp_testbed import wait_until
from robotapp_testbed.processes import guard

pytestmark = pytest.mark.live

BUSY = "kubectl robotapp info can-rival"


def test_a_cluster_stays_until_it_is_taken_down(shell: Shell) -> None:
    up = shell.run("up", "--install", "--fleet", "1,1,0")
    assert up.returncode == 0, up.stderr
    state = shell.cluster().state()
    assert state is not None
    assert up.stdout == f"export KUBECONFIG={state.run_dir}/kubeconfigs/admin.yaml\n"
    assert set(state.processes) == {"etcd", "kube-apiserver", "kube-controller-manager", "kwok"}

    again = shell.run("up")
    assert again.stdout == up.stdout, "a second `up` finds the running cluster"

    lines = shell.run("env", "--identity", "tenant").stdout
    script = f"{lines}\nkubectl auth whoami -o jsonpath='{{.status.userInfo.username}}'"
    whoami = subprocess.run(["/bin/sh", "-c", script], capture_output=True, text=True, check=False)
    assert whoami.stdout == "tenant"
    unknown = shell.run("env", "--identity", "nobody")
    assert unknown.returncode == 1
    assert "there are admin, kube-controller-manager" in unknown.stderr
    shown = subprocess.run(
        ["/bin/sh", "-c", f"{up.stdout}\nexport PATH={state.run_dir}/bin\nkubectl get nodes,ntel"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert shown.stdout.count("robot-1") == 2, shown.stderr

    status = shell.run("status").stdout
    assert ["kube-apiserver", str(state.processes["kube-apiserver"])] in [
        line.split()[:2] for line in status.splitlines()
    ]

    down = shell.run("down")
    assert down.returncode == 0, down.stderr
    assert not Path(state.run_dir).exists()
    assert not any(guard.start_time(pid) for pid in [state.holder_pid, *state.processes.values()])
    assert shell.run("status").returncode == 3


def test_tutorial_and_examples_run_line_by_line_as_their_pages_have_them(reader: Reader) -> None:
    """One after the other on one cluster: both start the same one."""
    reader.follows((EXAMPLES.parent / "docs/tutorial.md").read_text())

    text = (EXAMPLES / "README.md").read_text()
    first, *lines, last = text.partition("```\n")[2].partition("```")[0].splitlines()
    assert (first, last) == (". .venv/bin/activate", DOWN)
    for line in lines:
        output = reader.types(line)
        if "info can-rival" in line:
            assert wait_until(
                lambda: "can-can0 on amr-07 is held by default/can-holder" in reader.types(BUSY), timeout_s=60
            ), output
        if line.startswith("kubectl wait"):
            assert "condition met" in output
    devices = reader.types("kubectl robotapp devices")
    assert re.search(r"amr-07 +can-can0 +can +can0 +default/can-rival", devices), devices
    assert "60.0 ms to amr-07 > 30 ms" in reader.types("kubectl robotapp explain teleop")


def test_a_killed_holder_leaves_nothing_and_up_starts_anew(shell: Shell) -> None:
    first = shell.run("up", "--name", "second")
    state = shell.cluster("second").state()
    assert state is not None, first.stderr
    os.kill(state.holder_pid, signal.SIGKILL)
    assert wait_until(lambda: not Path(state.run_dir).exists(), timeout_s=60)
    assert not any(guard.start_time(pid) for pid in state.processes.values())
    assert shell.cluster("second").state() is None
    again = shell.run("up", "--name", "second")
    assert again.returncode == 0, again.stderr


@pytest.fixture
def starting(shell: Shell) -> Iterator[subprocess.Popen[str]]:
    """`up` while its cluster starts: the holder has begun, nothing serves yet."""
    command = [sys.executable, "-m", "robotapp_testbed", "up"]
    with subprocess.Popen(command, env=shell.env, stderr=subprocess.PIPE, text=True) as up:
        assert wait_until(lambda: bool(list(shell.temporary.iterdir())), timeout_s=60, poll_s=0.01)
        assert shell.cluster().state() is None
        yield up


def test_an_interrupted_up_takes_the_cluster_it_started_with_it(shell: Shell, starting: subprocess.Popen[str]) -> None:
    holder = shell.cluster().holder()
    starting.send_signal(signal.SIGINT)
    assert starting.wait(120) == 130
    assert holder is not None
    assert not holder.lives
    assert list(shell.temporary.iterdir()) == []


def test_down_ends_a_cluster_that_still_starts(shell: Shell, starting: subprocess.Popen[str]) -> None:
    starting.kill()  # nobody waits for it any more; it goes on
    down = shell.run("down")
    assert (down.returncode, down.stderr) == (0, "")
    assert shell.cluster().holder() is None
    assert list(shell.temporary.iterdir()) == []


def test_two_ups_at_once_start_one_cluster(shell: Shell) -> None:
    command = [sys.executable, "-m", "robotapp_testbed", "up"]
    both = [
        subprocess.Popen(command, env=shell.env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        for _ in range(2)
    ]
    outputs = [process.communicate(timeout=240) for process in both]
    assert [process.returncode for process in both] == [0, 0], outputs
    assert outputs[0][0] == outputs[1][0] != ""


def test_a_start_that_fails_shows_why(shell: Shell, tmp_path: Path) -> None:
    broken = tmp_path / "binaries" / "kwok"
    broken.unlink()
    shutil.copy("/bin/false", broken)
    answer = shell.run("up")
    assert answer.returncode == 1
    assert "kwok ended with 1 while starting" in answer.stderr
    assert "the whole story is in" in answer.stderr
    assert "Traceback" not in answer.stderr
