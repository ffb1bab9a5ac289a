"""Options and commands about real nodes."""

from pathlib import Path

import pytest

from robotapp_testbed import cli, cli_nodes
from robotapp_testbed.binaries import programs
from robotapp_testbed.processes.detached import Cluster, State
from robotapp_testbed.real import UnavailableError, prerequisites
from robotapp_testbed.switch.control import Control
from robotapp_testbed.switch.links import Link, LinkChange


@pytest.fixture(autouse=True)
def _home(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))


def parsed(*argv: str) -> "cli_nodes.argparse.Namespace":
    return cli._parser().parse_args(["up", *argv])


@pytest.mark.parametrize(
    ("text", "names"), [("3", ["node-1", "node-2", "node-3"]), ("robot-1,edge-1", ["robot-1", "edge-1"]), ("a", ["a"])]
)
def test_nodes_are_counted_or_named(text: str, names: list[str]) -> None:
    assert parsed("--nodes", text).nodes.names == names


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


def test_the_holder_gets_the_same_options() -> None:
    options = ["--nodes=robot-1,edge-1", "--delay=robot-1,edge-1=2.5", "--image=tools"]
    assert cli._passed_on(parsed(*options)) == options
    assert cli_nodes.passed_on(parsed()) == []


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (["--nodes", "a,b", "--delay", "a,c=5"], "a delay names c, but the nodes are a, b"),
        (
            ["--nodes", "a,b", "--delay", "a,b=5", "--delay", "a,b=6"],
            "the delay between a and b is there twice: it is that of both ways",
        ),
        (["--nodes", "a,a"], "nodes need different names: a is there twice"),
        (["--nodes", "999"], "a cluster has 1 to 200 real nodes, not 999"),
        (["--delay", "a,b=5"], "--delay without real nodes: say which with --nodes"),
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


def test_a_cluster_that_runs_stays_as_it_is(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    state = State(1, "https://198.18.0.1:1", str(tmp_path), {})
    monkeypatch.setattr(Cluster, "state", lambda _: state)
    assert cli.main(["up", "--nodes", "4"]) == 0
    said = capsys.readouterr()
    assert "the cluster 'default' runs already and stays as it is" in said.err
    assert "Ready after" not in said.err
    assert said.out == f"export KUBECONFIG={tmp_path}/kubeconfigs/admin.yaml\n"


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


class Links:
    """The switch's side of `link`."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
        self.asked: list[object] = []
        (folder / "switch.sock").touch()
        self.state = State(1, "https://198.18.0.1:1", str(folder), {})
        links = {("a", "b"): Link(delay_ms=5, loss=0.1), ("b", "a"): Link(down=True), ("a", "c"): Link(mbit_s=8)}
        monkeypatch.setattr(Control, "links", lambda _: links)
        monkeypatch.setattr(Control, "known", lambda _: ["a", "b", "c"])
        monkeypatch.setattr(Control, "apply", lambda _, changes: self.asked.extend(changes))
        monkeypatch.setattr(Control, "set_link", lambda _, *ends, **values: self.asked.append((ends, values)))
        monkeypatch.setattr(Control, "set_node", lambda _, *ends, **values: self.asked.append((ends, values)))
        monkeypatch.setattr(cli, "_running", lambda _: self.state)


@pytest.fixture
def links(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Links:
    return Links(monkeypatch, tmp_path)


def test_links_are_shown_for_all_or_for_the_named_nodes(links: Links, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["link"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 4
    assert cli.main(["link", "a", "b"]) == 0
    _, there, back = capsys.readouterr().out.splitlines()
    assert there.split() == ["a", "b", "5", "0", "0.1", "-", "up"]
    assert back.split() == ["b", "a", "0", "0", "0", "-", "down"]
    assert links.asked == []


def test_only_what_is_given_is_set(links: Links) -> None:
    assert cli.main(["link", "a", "b", "--delay-ms", "15", "--down", "no", "--one-way"]) == 0
    assert cli.main(["link", "a", "--loss", "0.5"]) == 0
    assert links.asked == [
        (("a", "b"), {"one_way": True, "delay_ms": 15.0, "down": False}),
        (("a",), {"loss": 0.5}),
    ]


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
    links: Links, argv: list[str], reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["link", *argv]) == 1
    assert reason in capsys.readouterr().err
    assert links.asked == []


def test_a_cluster_without_a_switch_says_how_to_get_one(links: Links, capsys: pytest.CaptureFixture[str]) -> None:
    Path(links.state.run_dir, "switch.sock").unlink()
    assert cli.main(["link"]) == 1
    assert "up --nodes" in capsys.readouterr().err


def test_a_switch_that_died_is_one_sentence(
    links: Links, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refused(_: Control) -> None:
        raise ConnectionRefusedError(111, "Connection refused")

    monkeypatch.setattr(Control, "known", refused)
    assert cli.main(["link"]) == 1
    said = capsys.readouterr().err
    assert said.startswith("the latency switch does not answer")
    assert f"{links.state.run_dir}/latency-switch.log" in said


def test_a_trace_is_replayed_with_a_line_per_step(
    links: Links, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    trace = tmp_path / "trace.yaml"
    trace.write_text("{steps: [{at_s: 0, links: [{between: [a, b], delay_ms: 5}, {node: c, down: true}]}]}")
    assert cli.main(["replay", str(trace)]) == 0
    assert links.asked == [LinkChange({"delay_ms": 5}, origin="a", target="b"), LinkChange({"down": True}, node="c")]
    said = capsys.readouterr()
    assert said.out.split() == ["0.0", "s", "a-b", "delay_ms=5;", "c", "down=True"]
    assert "1 steps applied" in said.err


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (None, "trace.yaml cannot be read"),
        ("{steps: [{at_s: 0, links: [{node: d, loss: 0}]}]}", "there is no node d; the switch knows a, b, c"),
        ("{steps: [{at_s: 0, links: [{node: a, loss: 7}]}]}", "steps[0].links[0].loss: 7 is not between 0 and 1"),
    ],
)
def test_a_trace_that_cannot_be_replayed_is_one_sentence(
    links: Links, text: str | None, reason: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if text is not None:
        (tmp_path / "trace.yaml").write_text(text)
    assert cli.main(["replay", str(tmp_path / "trace.yaml")]) == 1
    assert reason in capsys.readouterr().err
    assert links.asked == []
