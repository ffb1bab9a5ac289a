"""Options and commands about real nodes."""

from pathlib import Path

import pytest

from robotapp_testbed import cli, cli_nodes
from robotapp_testbed.binaries import programs
from robotapp_testbed.processes.detached import State
from robotapp_testbed.real import UnavailableError, prerequisites
from robotapp_testbed.switch.control import Control


@pytest.fixture(autouse=True)
def _home(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))


def parsed(*argv: str) -> "cli_nodes.argparse.Namespace":
    return cli._parser().parse_args(["up", *argv])


def test_real_nodes_of_a_fleet_file_get_its_devices_and_distances_unless_a_delay_is_given() -> None:
    arguments = parsed("--nodes", "examples/fleet/factory.yaml", "--delay", "edge-1,amr-07=9")
    assert arguments.nodes.names == ["amr-07", "amr-08", "edge-1", "edge-2", "cloud-1"]
    delays = cli_nodes._delays(arguments)
    assert (delays["edge-1", "amr-07"], delays["amr-07", "edge-2"], delays["amr-07", "cloud-1"]) == (9, 7.5, 30)
    assert len(delays) == 10
    (option,) = [each for each in cli_nodes.passed_on(arguments) if each.startswith("--nodes")]
    assert parsed(option).nodes.nodes == arguments.nodes.nodes, "the holder reads the same file, wherever it runs"


@pytest.mark.parametrize(
    ("option", "reason"),
    [
        (["--nodes", "Robot_1"], "is neither a number nor node names"),
        (["--nodes", "a,,b"], "is neither a number nor node names"),
        (["--nodes", "0"], "is neither a number nor node names"),
        (["--delay", "a=5"], "is not A,B=MS"),
        (["--delay", "a,b=soon"], "is not A,B=MS"),
        (["--delay", "a,b=-5"], "is not A,B=MS"),
        (["--image", "pause"], "invalid choice"),
        (["--nodes", "none.yaml"], "none.yaml cannot be read"),
        (["--fleet", "none.yaml"], "none.yaml cannot be read"),
    ],
)
def test_wrong_options_are_explained(option: list[str], reason: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        parsed(*option)
    assert ended.value.code == 2
    assert reason in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (["--nodes", "a,b", "--delay", "a,c=5"], "a delay names c, but the nodes are a, b"),
        (["--delay", "a,b=5", "--image", "ros2"], "--delay and --image without real nodes: say which with --nodes"),
    ],
)
@pytest.mark.parametrize("held", [[], ["--hold"]])
def test_what_cannot_start_is_refused_at_once(
    options: list[str],
    held: list[str],
    reason: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(
        "robotapp_testbed.binaries.assets.Assets.resolve", lambda *_: pytest.fail("nothing is to be built")
    )
    assert cli.main(["up", *options, *held]) == 1
    assert capsys.readouterr().err == f"{reason}\n"


def test_a_machine_that_cannot_is_told_before_anything_is_made(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse() -> None:
        raise UnavailableError("real nodes need root")

    monkeypatch.setattr(prerequisites, "require", refuse)
    monkeypatch.setattr(programs, "build", lambda _: pytest.fail("nothing is to be compiled"))
    monkeypatch.setattr(
        "robotapp_testbed.binaries.assets.Assets.resolve", lambda *_: pytest.fail("no minutes of compiling")
    )
    assert cli.main(["up", "--nodes", "2"]) == 1
    assert capsys.readouterr().err == "real nodes need root\n"


@pytest.mark.parametrize("problem", [None, UnavailableError("real nodes need runc: apt-get install runc")])
def test_the_doctor_says_what_is_there_and_what_is_not(
    problem: UnavailableError | None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(prerequisites, "missing_packages", lambda: ["runc"] if problem else [])
    monkeypatch.setattr(prerequisites, "missing", lambda: problem)
    assert cli.main(["doctor"]) == (1 if problem else 0)
    said = capsys.readouterr().out
    assert ("missing runc" in said) == bool(problem)
    assert said.splitlines()[-1].startswith("real nodes need runc" if problem else "real nodes can run here")


@pytest.mark.parametrize(
    ("argv", "reason"),
    [
        (["--loss", "0.5"], "name the node or the two nodes"),
        (["a", "b", "c", "--loss", "0.5"], "a link has two ends, not 3"),
        (["a", "b", "c"], "a link has two ends, not 3"),
        (["a", "robot-9"], "there is no node robot-9; the cluster has a, b, c"),
        (["a", "--loss", "0.5", "--one-way"], "--one-way is about what is set from one node to another"),
        (["a", "b", "--one-way"], "--one-way is about what is set from one node to another"),
        (["a", "--loss", "7"], "--loss: 7.0 is not between 0 and 1"),
    ],
)
def test_what_cannot_be_set_is_said(
    argv: list[str], reason: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "switch.sock").touch()
    monkeypatch.setattr(cli, "_running", lambda _: State(1, "https://198.18.0.1:1", str(tmp_path), {}))
    monkeypatch.setattr(Control, "known", lambda _: ["a", "b", "c"])
    for name in ("set_link", "set_node"):
        monkeypatch.setattr(Control, name, lambda *_, **__: pytest.fail("nothing is to be set"))
    assert cli.main(["link", *argv]) == 1
    assert reason in capsys.readouterr().err
