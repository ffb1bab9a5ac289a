"""kubectl robotapp lint: files in, lines like a compiler's out, no cluster and no kubeconfig."""

import io
import json
import re
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from click.testing import Result
from tests.support.apiobjects import app, component, pool
from typer.testing import CliRunner

from robotapp_cli.commands.linting import show_lint
from robotapp_cli.main import app as cli
from robotapp_cli.output import Output

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
RESERVE_A_BUS = ("can-holder.yaml", "can-rival.yaml")
OLD = """\
apiVersion: robotics.io/v1alpha1
kind: RobotApp
metadata:
  name: teleop
spec:
  dds:
    domain: 7
  components:
  - name: driver
    image: ros:jazzy
    runsOn: Robot
"""


def run(*arguments: str, text: str | None = None) -> Result:
    return CliRunner(env={"KUBECONFIG": "/nowhere/config", "HOME": "/nowhere"}).invoke(
        cli, ["lint", *arguments], input=text
    )


def written(folder: Path, *objects: dict[str, Any], name: str = "app.yaml") -> str:
    path = folder / name
    path.write_text(yaml.safe_dump_all(objects, sort_keys=False))
    return str(path)


def test_the_examples_have_nothing_wrong() -> None:
    others = {EXAMPLES / name for name in ("tenant-quota.yaml", "runs.yaml", *RESERVE_A_BUS)}
    files = sorted({*EXAMPLES.glob("*.yaml")} - others)
    result = run(*map(str, files))
    assert (result.exit_code, result.stdout) == (0, f"nothing wrong in {len(files)} RobotApps\n")


def test_examples_that_reserve_a_bus_and_open_none_are_told_what_a_program_that_does_would_need() -> None:
    result = run(*(str(EXAMPLES / name) for name in RESERVE_A_BUS))
    assert result.exit_code == 0
    notes = [line for line in result.stdout.splitlines() if line.startswith(str(EXAMPLES))]
    assert len(notes) == len(RESERVE_A_BUS)
    assert all("devices[0].type: a CAN bus is" in note and "hostNetwork: true" in note for note in notes)


def test_each_finding_is_a_line_with_its_place_and_the_last_line_counts_them() -> None:
    result = run("-", text=OLD)
    assert result.exit_code == 1
    assert result.stdout.splitlines() == [
        "-:5:1: error: spec.ros: this field is missing; write ros: {distro: …} (ROS version and distribution)",
        "-:6:3: error: spec.dds: unknown field; write ros2",
        '-:11:13: error: spec.components[0].runsOn: must be a list, but is the text "Robot"; write [Robot]',
        "3 errors in 1 RobotApp",
    ]


def test_warnings_are_no_errors(tmp_path: Path) -> None:
    result = run(written(tmp_path, {**app(), "status": {}}, pool()))
    assert result.exit_code == 0
    assert ": warning: status: " in result.stdout
    assert result.stdout.endswith("1 warning in 1 DomainPool and 1 RobotApp\n")


def test_files_may_be_named_as_kubectl_apply_takes_them(tmp_path: Path) -> None:
    named = written(tmp_path, app())
    written(tmp_path, app(), name="b.yml")
    (tmp_path / "README.md").write_text("no YAML: {")
    assert run("-f", named).stdout == "nothing wrong in 1 RobotApp\n"
    assert run(str(tmp_path)).stdout == "nothing wrong in 2 RobotApps\n"
    (tmp_path / "empty").mkdir()
    assert "has no file *.yaml" in run(str(tmp_path / "empty")).output
    assert run().exit_code == 2


def test_what_is_not_checked_is_counted(tmp_path: Path) -> None:
    others = [{"apiVersion": "v1", "kind": "ConfigMap"}] * 2
    result = run(written(tmp_path, app(), *others))
    assert result.exit_code == 0
    assert result.stdout == "nothing wrong in 1 RobotApp; 2 objects of other kinds were not checked\n"
    assert "1 object of another kind was not checked" in run(written(tmp_path, app(), others[0])).stdout


EMPTY_LIST = "apiVersion: v1\nkind: List\nitems: []\n"
NOTHING = ["", "\n\n", "# only a comment\n", "---\n", "---\n# one\n---\n...\n", "\ufeff", "null\n", EMPTY_LIST]


@pytest.mark.parametrize("text", NOTHING)
def test_nothing_to_check_is_an_error_that_shows_what_is_expected(text: str, tmp_path: Path) -> None:
    path = tmp_path / "empty.yaml"
    path.write_text(text)
    for result, name in ((run("-", text=text), "-"), (run(str(path)), str(path))):
        assert result.exit_code == 1
        assert result.stdout == (
            f"{name}:1:1: error: there is no object here; write a RobotApp (apiVersion: robotics.io/v1alpha1, "
            "kind: RobotApp), or give the file of one\n1 error in no RobotApp\n"
        )
    data = json.loads(run("-o", "json", str(path)).stdout)
    assert (data["errors"], data["findings"][0]["reason"]) == (1, "NoObject")


def test_objects_of_other_kinds_alone_are_nothing_to_check(tmp_path: Path) -> None:
    other = {"apiVersion": "v1", "kind": "ConfigMap"}
    one, two = written(tmp_path, other), written(tmp_path, other, other, name="two.yaml")
    result = run(one, two)
    assert result.exit_code == 1
    first, second, totals = result.stdout.splitlines()
    expected = "there is no RobotApp or DomainPool here, only {}; give the file of the RobotApp"
    assert first == f"{one}:1:1: error: {expected.format('an object of another kind, which is not checked')}"
    assert second == f"{two}:1:1: error: {expected.format('2 objects of other kinds, which are not checked')}"
    assert totals == "2 errors in no RobotApp; 3 objects of other kinds were not checked"


def test_an_empty_file_beside_a_robotapp_is_nothing_wrong(tmp_path: Path) -> None:
    """As with kubectl: a chart renders files of comments alone."""
    result = run(written(tmp_path, name="empty.yaml"), written(tmp_path, app()))
    assert (result.exit_code, result.stdout) == (0, "nothing wrong in 1 RobotApp\n")


def test_programs_get_the_same_as_json_and_yaml(tmp_path: Path) -> None:
    good, bad = written(tmp_path, app(), name="good.yaml"), written(tmp_path, app(suspend="no"), name="bad.yaml")
    result = run("-o", "json", good, bad)
    assert result.exit_code == 1
    data = json.loads(result.stdout)
    assert yaml.safe_load(run("-o", "yaml", good, bad).stdout) == data
    (finding,) = data.pop("findings")
    assert data == {"errors": 1, "warnings": 0, "checked": {"RobotApp": 2}, "skipped": 0}
    assert finding == {
        "file": bad,
        "line": 14,
        "column": 12,
        "severity": "error",
        "object": "RobotApp/teleop",
        "path": "spec.suspend",
        "reason": "WrongType",
        "message": 'must be true or false, but is the text "no"',
    }


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "give a FILE with a RobotApp"),
        (["/nowhere.yaml"], "/nowhere.yaml cannot be read: No such file or directory"),
        (["/proc/self/task"], "has no file *.yaml, *.yml or *.json"),
        (["-o", "xml", "-"], "xml"),
        (["--context", "x", "-"], "context"),
    ],
)
def test_wrong_usage_ends_with_code_2(arguments: list[str], message: str) -> None:
    result = run(*arguments)
    assert result.exit_code == 2
    assert message in result.stderr
    assert "Traceback" not in result.output


@pytest.mark.parametrize("data", [b"\xff\xfe", b"a: [", b"a:\n\t- b", b"[" * 5000, b"a: &a [*a]", b"a: 1\na: 2"])
def test_what_is_no_yaml_is_a_finding_and_never_a_traceback(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "app.yaml"
    path.write_bytes(data)
    result = run(str(path))
    assert result.exit_code == 1
    assert result.stdout.startswith(f"{path}:")
    assert re.search(r"\d errors? in no RobotApp\n\Z", result.stdout)
    assert isinstance(result.exception, SystemExit)


def test_what_a_terminal_would_obey_is_shown_and_not_sent(tmp_path: Path) -> None:
    hostile = app(components=[component(name="\x1b[31m\nred", image="i")])
    lines = run(written(tmp_path, hostile)).stdout.splitlines()
    assert len(lines) == 2
    assert "\x1b" not in lines[0]
    assert "\\u001b[31m\\nred" in lines[0]


def test_a_terminal_without_unicode_gets_escapes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    monkeypatch.setattr(sys, "stdout", out)
    show_lint([Path(written(tmp_path, app(components=[component(qosClass="ü")])))], Output.TABLE)
    out.seek(0)
    assert '"\\xfc" is not possible' in out.read()


def test_the_help_shows_how_to_check_what_helm_renders() -> None:
    text = " ".join(run("--help").stdout.split())
    assert "helm template my-robots | kubectl robotapp lint -" in text
    assert "Check files without a cluster" in text
