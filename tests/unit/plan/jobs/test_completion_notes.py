"""Notes about apps that do not end although they are written to."""

from typing import Any

import pytest

from robotapp_api.checks.spec import spec_notes
from robotapp_api.model.app.robotapp import RobotAppSpec

MATRIX = {"parameters": [{"name": "seed", "values": ["1", "2"]}]}


def notes_of(*jobs: dict[str, Any], **fields: Any) -> list[str]:
    parts = [{"image": "team/sim:1", "args": ["run"], "job": {}, **job} for job in jobs]
    spec = RobotAppSpec.model_validate({"ros": {"distro": "jazzy"}, "components": parts, **fields})
    return [str(note) for note in spec_notes(spec) if "ends no instance" in str(note)]


@pytest.mark.parametrize(("field", "value"), [("completion", {"deadline": "5m"}), ("matrix", MATRIX)])
def test_an_app_whose_jobs_are_all_suspended_is_told_that_nothing_ends_it(field: str, value: dict[str, Any]) -> None:
    (note,) = notes_of({"name": "sim", "replicas": 0}, **{field: value})
    assert note.startswith(f"spec.{field}")
    assert "(sim)" in note
    assert notes_of({"name": "sim", "replicas": 0}, {"name": "save"}, **{field: value}) == []


def test_jobs_that_do_not_count_for_success_end_nothing() -> None:
    jobs = {"name": "sim", "replicas": 0}, {"name": "save"}
    assert notes_of(*jobs, completion={"success": {"components": ["sim"]}})
    assert not notes_of(*jobs, completion={"success": {"components": ["save"]}})


def test_an_app_without_completion_is_told_nothing() -> None:
    assert notes_of({"name": "sim", "replicas": 0}) == []


@pytest.mark.parametrize(
    ("ttl", "has_note"),
    [("0s", True), ("3600ms", True), ("9s", True), ("10s", False), ("1h", False), ("999999h999999h999999h", False)],
)
def test_a_ttl_in_which_nobody_reads_a_log_has_a_note(ttl: str, has_note: bool) -> None:
    part = {"name": "save", "image": "team/save:1", "job": {}}
    spec = RobotAppSpec.model_validate({"ros": {"distro": "jazzy"}, "components": [part], "completion": {"ttl": ttl}})
    notes = [note for note in spec_notes(spec) if note.field == "spec.completion.ttl"]
    assert [ttl in note.message and "1h" in note.message for note in notes] == [True] * has_note


def test_a_sweep_without_any_job_is_refused_for_that_and_told_nothing_else() -> None:
    parts = [{"name": "sim", "image": "team/sim:1"}]
    spec = RobotAppSpec.model_validate({"ros": {"distro": "jazzy"}, "components": parts, "matrix": MATRIX})
    assert not [note for note in spec_notes(spec) if "ends no instance" in str(note)]
