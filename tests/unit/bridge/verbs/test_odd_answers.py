"""A program that is no kubectl, or one that was cut off: every command ends with a line and code 74."""

from pathlib import Path

import pytest
from tests.support.rigel.rigelfiles import orchestration

from rigel_bridge.main import main

ANSWERS = {
    "nothing": "",
    "an empty object": "{}",
    "a list": "[]",
    "nothing known": "null",
    "no items": '{"items": null}',
    "items without names": '{"items": [{"metadata": {}}], "metadata": {"name": "teleop"}}',
    "half an object": '{"metadata": {"name": "teleop"',
    "an app without a uid": '{"metadata": {"name": "teleop", "namespace": "fleet"}, "spec": {}}',
    "no end of depth": "[" * 100_000,
}


@pytest.mark.parametrize("answer", ANSWERS.values(), ids=ANSWERS)
@pytest.mark.parametrize("verb", ["apply", "status", "rollback", "delete", "collect", "migrate"])
def test_an_answer_that_no_kubectl_gives_is_one_line(
    verb: str, answer: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("Rigelfile").write_text(orchestration("{name: teleop}"))
    Path("answer").write_text(answer)
    program = Path("kubectl")
    program.write_text(f"#!/bin/sh\nexec cat {tmp_path}/answer\n")
    program.chmod(0o755)
    more = ["out"] if verb == "collect" else ["--wait", "0"] if verb == "delete" else []
    assert main([verb, *more, "--kubectl", "./kubectl"]) == 74
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("kubectl: ")
    assert len(line) < 400
