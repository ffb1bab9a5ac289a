"""Verbs that people guess, and --version."""

import re

import pytest
import typer
from typer.testing import CliRunner

from robotapp_cli.main import app
from robotapp_cli.verbs import ANSWERS
from robotapp_cli.written import object_name


def run(*words: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, words)
    return result.exit_code, result.output


@pytest.mark.parametrize("verb", sorted(ANSWERS))
def test_a_guessed_verb_is_answered_with_the_command_that_does_it(verb: str) -> None:
    code, text = run(verb, "teleop")
    assert code == 2
    assert ANSWERS[verb] in re.sub(r"\s+", " ", text)


def test_every_answer_names_a_verb_that_exists() -> None:
    commands = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    assert not ANSWERS.keys() & commands.keys()
    for answer in ANSWERS.values():
        for verb in re.findall(r"kubectl robotapp (\w[\w-]*)", answer):
            assert verb in commands


def test_a_slip_of_the_finger_is_answered_with_the_nearest_verb() -> None:
    code, text = run("lisst")
    assert code == 2
    assert "Did you mean 'list'" in text


def test_the_version_is_that_of_the_package() -> None:
    assert run("--version") == (0, "kubectl-robotapp 0.1.0\n")


@pytest.mark.parametrize(
    ("words", "answer"),
    [
        (("list", "-o", "name"), "kubectl get ra -o name"),
        (("list", "--output=name"), "kubectl get ra -o name"),
        (("nodes", "-w"), "kubectl get ra -w"),
        (("explain", "teleop", "--watch"), "kubectl get ra -w"),
        (("list", "-l", "a=b"), "kubectl get ra -l"),
    ],
)
def test_options_of_kubectl_are_answered_with_the_command_that_has_them(words: tuple[str, ...], answer: str) -> None:
    code, text = run(*words)
    assert code == 2
    assert answer in re.sub(r"\s+", " ", text)


@pytest.mark.parametrize("name", ["ra/teleop", "robotapp/teleop", "robotapps.robotics.io/teleop", "RobotApp/teleop"])
def test_a_name_may_have_its_kind_in_front_as_kubectl_prints_it(name: str) -> None:
    assert object_name(name) == "teleop"


@pytest.mark.parametrize("name", ["pod/teleop", "ra/", "ra/a/b", "/teleop"])
def test_another_kind_or_no_name_behind_one_is_refused(name: str) -> None:
    with pytest.raises(typer.BadParameter):
        object_name(name)
