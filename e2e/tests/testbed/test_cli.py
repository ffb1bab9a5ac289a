import fcntl
import json
import signal
import subprocess
import sys
from collections.abc import Iterable, Iterator
from dataclasses import asdict

import pytest

from robotapp_testbed import ControlPlane, cli
from robotapp_testbed.binaries import pins, programs
from robotapp_testbed.binaries.assets import Assets
from robotapp_testbed.failures import TestbedError
from robotapp_testbed.processes.detached import Cluster, Holder
from robotapp_testbed.real import RealNodes, prerequisites


@pytest.fixture(autouse=True)
def _home(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))


@pytest.mark.parametrize(
    ("command", "reason"),
    [
        (["up", "--fleet", "2,2"], "is not three numbers such as 2,2,1"),
        (["up", "--fleet", "a,b,c"], "is not three numbers"),
        (["build", "--release-url", "docker=http://x"], "SOURCE one of kubernetes, etcd, helm"),
        (["build", "--release-url", "etcd"], "is not SOURCE=URL"),
        (["build", "minikube"], "there is no 'minikube', known are etcd, kube-apiserver"),
        (["build", "--for", "nothing"], "choose from"),
        (["rebuild"], "invalid choice"),
        ([], "required"),
    ],
)
def test_wrong_arguments_are_explained(command: list[str], reason: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main(command)
    assert ended.value.code == 2
    assert reason in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "names"),
    [
        (["etcd", "kubectl", "etcd"], {"etcd", "kubectl"}),
        (["pause"], {"pause"}),
        (["cel-cost"], {"cel-cost"}),
        (["--for", "simulated"], {*ControlPlane(kube_scheduler=True).binary_names}),
        (["--for", "real"], {*RealNodes(["node-1"]).binary_names, *programs.FOLDERS}),
        (["--for", "real", "--for", "simulated"], {*pins.NAMES, *programs.FOLDERS}),
        (["pause", "--for", "simulated"], {*ControlPlane(kube_scheduler=True).binary_names, "pause"}),
    ],
)
def test_build_gets_what_it_is_asked_for(
    options: list[str], names: set[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(Assets, "resolve", lambda _, names: dict.fromkeys(names, "/somewhere"))
    monkeypatch.setattr(programs, "build", lambda name: f"/compiled/{name}")
    assert cli.main(["build", *options]) == 0
    assert {line.split()[0] for line in capsys.readouterr().out.splitlines()} == names


SIMULATED = {"etcd", "kube-apiserver", "kube-controller-manager", "kwok", "kubectl", "helm"}
REAL = SIMULATED - {"kwok"} | {"kube-scheduler", "kubelet", "kube-proxy"}


@pytest.mark.parametrize(
    ("options", "names"),
    [
        ([], SIMULATED),
        (["--run", "--fleet", "2,2,1"], SIMULATED),
        (["--kube-scheduler"], SIMULATED | {"kube-scheduler"}),
        (["--nodes", "2"], REAL),
        (["--nodes", "2", "--fleet", "1,0,0"], REAL | {"kwok"}),
    ],
)
@pytest.mark.parametrize("held", [[], ["--hold"]])
def test_up_gets_the_binaries_of_its_nodes_and_no_others(
    options: list[str], names: set[str], held: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    wanted: list[str] = []

    def stop(_: Assets, names: Iterable[str]) -> None:
        wanted.extend(names)
        raise TestbedError("nothing is started")

    monkeypatch.setattr(Assets, "resolve", stop)
    monkeypatch.setattr(prerequisites, "require", lambda: None)
    assert cli.main(["up", *options, *held]) == 1
    assert set(wanted) == names


@pytest.mark.parametrize("command", ["env", "status"])
def test_without_a_cluster_it_says_how_to_start_one(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main([command]) == 3
    assert "start one with `python -m robotapp_testbed up`" in capsys.readouterr().err
    assert cli.main([command, "--name", "newuser"]) == 3
    assert "start one with `python -m robotapp_testbed up --name newuser`" in capsys.readouterr().err


def test_down_without_a_cluster_is_no_failure(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["down", "--name", "other"]) == 0
    assert "no cluster 'other' runs" in capsys.readouterr().err


def test_a_failure_is_one_message_without_a_traceback(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ROBOTAPP_ASSETS", "/no/such")
    assert cli.main(["build"]) == 1
    assert (
        capsys.readouterr().err
        == "ROBOTAPP_ASSETS=/no/such is not a folder: correct it, or run `unset ROBOTAPP_ASSETS`\n"
    )


def test_an_interrupt_says_that_nothing_is_lost(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Assets, "resolve", interrupted)
    assert cli.main(["build"]) == 130
    assert "run it again to go on" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["", "../up", "Big", "-x", "a" * 41])
def test_a_cluster_name_cannot_leave_its_folder(name: str) -> None:
    with pytest.raises(TestbedError, match="is no cluster name"):
        Cluster(name)


@pytest.fixture
def killed() -> Iterator[Cluster]:
    """A cluster whose holder was killed and left its files; the lock is the next holder's already."""
    cluster = Cluster("stale")
    program = f"""
import os, signal
from robotapp_testbed.processes.detached import Cluster
cluster = Cluster({cluster.name!r})
with cluster._holding():
    cluster._file.write_text('{{"holder_pid": %d, "server_url": "", "run_dir": "", "processes": {{}}}}' % os.getpid())
    assert cluster.state() is not None
    os.kill(os.getpid(), signal.SIGKILL)
"""
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert ended.returncode == -signal.SIGKILL, ended.stderr
    with cluster._lock.open() as file:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield cluster


def test_the_state_of_a_killed_holder_does_not_count_while_the_next_one_begins(killed: Cluster) -> None:
    assert killed._file.exists()
    assert killed.state() is None

    killed._lock.write_text(json.dumps(asdict(Holder.this())))
    assert killed.state() is None, "the lock's file is the new holder's, the state still the old one's"
