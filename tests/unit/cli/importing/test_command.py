"""kubectl robotapp import: files in, a RobotApp and a report out, no cluster and no kubeconfig."""

import json
from pathlib import Path

import yaml
from click.testing import Result
from typer.testing import CliRunner

from robotapp_cli.main import app

COMPOSE = "services:\n  nav:\n    image: ros:jazzy\n    command: a\n    networks: [x]\n  ui:\n    build: .\n"


def run(*arguments: str) -> Result:
    return CliRunner(env={"KUBECONFIG": "/nowhere/config", "HOME": "/home/ana"}).invoke(app, ["import", *arguments])


def write(folder: Path, text: str = COMPOSE) -> str:
    (folder / "compose.yaml").write_text(text)
    return str(folder / "compose.yaml")


def test_the_output_is_the_robotapp_and_the_report_goes_to_standard_error(tmp_path: Path) -> None:
    result = run(write(tmp_path), "--name", "robot")
    assert result.exit_code == 0
    robotapp = yaml.safe_load(result.stdout)
    assert (robotapp["kind"], robotapp["metadata"]) == ("RobotApp", {"name": "robot"})
    lines = result.stderr.splitlines()
    assert f"{tmp_path}/compose.yaml:4: taken: services.nav.command: args" in lines
    assert lines[-1] == "2 taken, 1 changed, 2 left out, 1 choose. Next: kubectl robotapp lint FILE"


def test_the_report_as_json(tmp_path: Path) -> None:
    report = json.loads(run(write(tmp_path), "--report", "json").stderr)
    assert (report["taken"], report["leftOut"], report["choose"]) == (2, 2, 1)
    assert report["lines"][0] == {
        "file": f"{tmp_path}/compose.yaml",
        "line": 3,
        "path": "services.nav.image",
        "verdict": "taken",
        "message": "image ros:jazzy",
    }


def test_a_file_is_written_once_and_never_overwritten(tmp_path: Path) -> None:
    output = tmp_path / "app.yaml"
    assert run(write(tmp_path), "-o", str(output)).exit_code == 0
    text = output.read_text()
    again = run(str(tmp_path), "-o", str(output), "--name", "other")
    assert (again.exit_code, output.read_text()) == (2, text)
    assert "not overwritten" in again.stderr


def test_lint_names_the_marked_places(tmp_path: Path) -> None:
    output = tmp_path / "app.yaml"
    run(write(tmp_path), "-o", str(output))
    result = CliRunner().invoke(app, ["lint", str(output)])
    assert result.exit_code == 1
    assert "spec.components[1].image: this place was marked by the import" in result.stdout


def test_mistakes_are_one_line_with_the_place_and_the_cure(tmp_path: Path) -> None:
    result = run(write(tmp_path, "services:\n  nav: {image: x, ports: [a]}\n"))
    assert result.exit_code == 2
    assert result.stderr == (
        f"error: {tmp_path}/compose.yaml:2: services.nav.ports[0]: 'a' is no port; write for example 8080:80 or 5000-5010:5000-5010/udp\n"
    )


def test_options_that_cannot_be_used_are_refused(tmp_path: Path) -> None:
    file = write(tmp_path)
    for arguments in (["--image", "x"], ["--env", "=x"], ["--distro", "jazy"], ["--env-file", "/nowhere"]):
        assert run(file, *arguments).exit_code == 2
    assert run(str(tmp_path / "none.yaml")).exit_code == 2
    (tmp_path / "empty").mkdir()
    assert "docker-compose.yml" in run(str(tmp_path / "empty")).stderr


def test_a_symbolic_link_is_not_read(tmp_path: Path) -> None:
    (tmp_path / "private").write_text("hush")
    folder = tmp_path / "project"
    folder.mkdir()
    (folder / "link").symlink_to(tmp_path / "private")
    result = run(write(folder, "services: {nav: {image: 'ros:jazzy', volumes: ['./link:/x']}}\n"))
    assert result.exit_code == 0
    assert "hush" not in result.stdout
    assert f"path: {folder}/link" in result.stdout
