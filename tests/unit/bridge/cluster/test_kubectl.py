"""Calls of kubectl: a program of the test's own stands for it."""

import fcntl
import sys
from pathlib import Path
from typing import IO

import pytest

from rigel_bridge.cluster.kubectl import ClusterError, Kubectl, Refusal, failure
from rigel_bridge.cluster.waiting import Clock
from rigel_bridge.document.failures import Exit


def program(folder: Path, body: str) -> Kubectl:
    """A kubectl of these lines of Python, called with a namespace flag."""
    path = folder / "kubectl"
    path.write_text(f"#!{sys.executable} -SI\nimport sys, time\n{body}\n")
    path.chmod(0o755)
    return Kubectl(str(path), flags=["--namespace=fleet"])


def test_arguments_arrive_as_they_are_and_input_and_output_pass_through(tmp_path: Path) -> None:
    kubectl = program(tmp_path, "print(sys.argv[1:]); print(sys.stdin.read())")
    out = kubectl.run("get", "$(reboot); a b", stdin="große Datei")
    assert out == "['--namespace=fleet', '--request-timeout=30s', 'get', '$(reboot); a b']\ngroße Datei\n"


def test_a_missing_kubectl_is_told_with_what_to_do() -> None:
    with pytest.raises(
        ClusterError, match=r"no-such-program is not an installed program: install kubectl, or .*--kubectl"
    ):
        Kubectl("no-such-program").run("version")


def test_output_without_end_is_cut_off(tmp_path: Path) -> None:
    kubectl = program(tmp_path, "while True: sys.stdout.write('x' * 65536)")
    with pytest.raises(ClusterError, match="wrote more than 1000000 bytes"):
        kubectl.binary("get", limit=1_000_000)


def test_a_program_that_does_not_end_is_ended(tmp_path: Path) -> None:
    kubectl = program(tmp_path, "time.sleep(600)")
    with pytest.raises(ClusterError, match=r"kubectl get did not end within 0.2 s"):
        kubectl.run("get", timeout_s=0.2)


def test_what_a_script_started_ends_with_it(tmp_path: Path) -> None:
    """`kubectl` is a script here and there; what it runs would write into the cluster after the bridge has given up."""
    lock = tmp_path / "held"
    take = f"import fcntl, time; held = open({str(lock)!r}, 'w'); fcntl.flock(held, fcntl.LOCK_EX)"
    holder = f"{take}; print('x' * 4096, flush=True); time.sleep(600)"
    script = tmp_path / "script"
    script.write_text(f'#!/bin/sh\n{sys.executable} -SI -c "{holder}"\n')
    script.chmod(0o755)
    with pytest.raises(ClusterError, match="wrote more than 1000 bytes"):
        Kubectl(str(script)).binary("get", limit=1000)
    with lock.open() as held:
        assert Clock().until(lambda: _is_free(held), timeout_s=30), "it is still running"


def _is_free(held: IO[str]) -> bool:
    try:
        fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def test_what_is_no_json_is_told(tmp_path: Path) -> None:
    for printed in ("hello", "[1]"):
        with pytest.raises(ClusterError, match="wrote no"):
            program(tmp_path, f"print({printed!r})").json("get")


@pytest.mark.parametrize(
    ("words", "reason", "told"),
    [
        ('Error from server (NotFound): robotapps "x" not found', Refusal.NOT_FOUND, 'robotapps "x" not found'),
        ("Error from server (Forbidden): user may not", Refusal.FORBIDDEN, "user may not"),
        ("Error from server (Weird): what", Refusal.OTHER, "what"),
        ('The RobotApp "x" is invalid:\n spec.a: wrong', Refusal.INVALID, 'The RobotApp "x" is invalid: spec.a: wrong'),
        ("E1122 19:28:58.9 31330 memcache.go:265] x\nWarning: old\nerror: bad", Refusal.OTHER, "kubectl: error: bad"),
        ("Operation cannot be fulfilled on robotapps x: modified", Refusal.CONFLICT, "modified"),
        ("Unable to connect to the server: dial tcp", Refusal.UNREACHABLE, "--context"),
        (
            'error: resource mapping not found: no matches for kind "RobotApp" in version',
            Refusal.OTHER,
            "install the chart",
        ),
        ('error: the server doesn\'t have a resource type "robotapps"', Refusal.OTHER, "install the chart"),
        ("", Refusal.OTHER, "kubectl get failed without a word"),
        ("x" * 100_000, Refusal.OTHER, "xxx"),
    ],
)
def test_refusals_have_a_reason_and_one_short_line(words: str, reason: Refusal, told: str) -> None:
    error = failure(words, ["get"])
    assert (error.reason, error.code) == (reason, Exit.CLUSTER)
    assert told in str(error)
    assert len(str(error)) < 2500
    assert "\n" not in str(error)
