"""`check`: every job and sequence, and what Rigel itself would refuse."""

from pathlib import Path

import pytest
from tests.support.rigel.jobfiles import G3
from tests.support.rigel.rigelfiles import ONE, orchestration

from rigel_bridge.main import main


def checked(text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], *flags: str) -> tuple[int, list[str]]:
    path = tmp_path / "app" / "Rigelfile"
    path.parent.mkdir(exist_ok=True)
    path.write_text(text)
    code = main(["check", str(path), *flags])
    return code, [line.replace(str(path), "F") for line in capsys.readouterr().out.splitlines()]


def test_every_sequence_is_rendered(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, lines = checked(G3, tmp_path, capsys)
    assert code == 0
    assert lines[:2] == ["generation g3: application in line 2 is a mapping", "by default: RobotApp detector"]
    assert "--sequence benchmark_default: RobotApp detector" in lines
    assert not any("without" in line for line in lines), "a sequence that deploys nothing is none of our business"


def test_every_mistake_of_the_file_is_listed_and_gives_the_exit_code(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = G3.replace("deploy, with: {scheduler_name: default-scheduler}", "deploi").replace(
        "scheduler_name: kube", "scheduler_nam: kube"
    )
    code, lines = checked(text, tmp_path, capsys)
    assert code == 72
    assert sum(line.startswith("error: F:") for line in lines) == 2


def test_mistakes_of_one_job_are_listed_together_each_as_if_those_before_it_were_mended(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    block = "deploy_ros_mastr: true\nscheduler: {policies: {latency_budget: 30, qos_class: real}}\nrobotapp: {edges: [{topic: /a, from: b, too: c}]}"
    code, lines = checked(orchestration(block, ONE.replace("command:", "comand:")), tmp_path, capsys)
    errors = [line.partition(": ")[2].partition(": ")[2] for line in lines if line.startswith("error: ")]
    assert code == 72
    assert [error.partition(":")[0].rpartition(".")[2] for error in errors[:4]] == [
        "comand",
        "deploy_ros_mastr",
        "qos_class",
        "latency_budget",
    ]
    assert errors[4] == "spec.edges[0].too is not a field of RobotApp (did you mean to?)"
    assert "mend the first ones first" in lines[len(errors)]


def test_what_is_missing_only_because_of_an_error_before_is_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, lines = checked(ONE.replace("command:", "xyz:"), tmp_path, capsys)
    assert code == 72
    assert [line for line in lines if line.startswith("error: ")] == lines[:1]
    assert not any("mend the first ones" in line for line in lines)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ("    compiler: colcn\n", "error: F:6: packages[0].compiler: 'colcn' is not allowed (did you mean colcon?)"),
        (
            "    platforms: [linux/arm]\n",
            "packages[0].platforms[0]: 'linux/arm' is not allowed (did you mean linux/arm64?)",
        ),
        ("    registry: {server: s, username: u}\n", "packages[0].registry: password is missing"),
        ("    registry: {server: s, username: u, pasword: p}\n", "is not known here (did you mean password?)"),
        ("    ssh: [{hostname: h, value: DEPLOY_KEY}]\n", "Rigel needs the environment variable DEPLOY_KEY"),
        ("    apt: curl\n", "packages[0].apt: expected a list, found text (curl)"),
        ("deploy: [{name: bridge}]\n", "deploy[0].name: expected AUTHOR/MODULE"),
        ("simulate: {introspection: []}\n", "simulate: plugins is missing"),
        ("simulate: {plugins: [], timeout: soon}\n", "simulate.timeout: expected a whole number"),
        ("    run: ['{{ NEVER }}']\n", "note: F:6: packages[0].run[0]: {{ NEVER }} is not in vars"),
    ],
)
def test_what_rigel_would_stumble_over_is_found(
    more: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, lines = checked(ONE + more, tmp_path, capsys)
    assert any(message in line for line in lines), lines


def test_a_password_from_the_environment_is_no_mistake(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = ONE + "    registry: {server: s, username: u, password: '{{ REGISTRY_PASSWORD }}'}\n"
    text = orchestration("image_pull_secrets: [s]", text + "    compiler: colcon\n")
    code, lines = checked(text, tmp_path, capsys, "--strict")
    assert code == 0, lines


def test_a_file_of_no_generation_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "Rigelfile"
    path.write_text("a: 1\n")
    assert main(["check", str(path)]) == 73
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (ONE, "compiler is not written, and Rigel takes catkin_make, which builds no ROS 2 (humble): write colcon"),
        (
            G3.replace("colcon", "catkin_make"),
            "jobs.dockerfile.with: compiler is catkin_make, which builds no ROS 2 (humble)",
        ),
    ],
)
def test_a_build_tool_of_ros_1_for_ros_2_is_noted(
    text: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, lines = checked(text, tmp_path, capsys)
    assert code == 0
    assert any(message in line for line in lines), lines
    _, lines = checked(ONE.replace("humble", "noetic"), tmp_path, capsys)
    assert not any("compiler" in line for line in lines)
