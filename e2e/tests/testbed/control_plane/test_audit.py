import json
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from robotapp_testbed.control_plane import audit

START = datetime(2026, 5, 1, tzinfo=UTC)


def record(verb: str, *, code: int = 200, user: str = "operator", resource: str = "pods") -> dict[str, Any]:
    return {
        "verb": verb,
        "responseStatus": {"code": code},
        "user": {"username": user},
        "objectRef": {"resource": resource},
    }


def test_a_line_the_server_is_still_writing_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "audit.jsonl"
    path.write_text(json.dumps(record("get")) + "\n" + '{"verb": "cre')
    assert audit.read(path) == [record("get")]


@pytest.mark.parametrize("first", range(12))
def test_records_since_a_second_are_those_that_ended_later_and_a_few_seconds_sooner(tmp_path: Path, first: int) -> None:
    path = tmp_path / "audit.jsonl"
    ends = [START + timedelta(seconds=10 * number) for number in range(10)]
    records = [record("get") | {"stageTimestamp": end.isoformat()} for end in ends]
    path.write_text("".join(json.dumps(each) + "\n" for each in records) + '{"verb": "cre')
    since = START + timedelta(seconds=10 * first)
    assert audit.read(path, since=since) == records[first:]
    assert audit.read(path, since=since + timedelta(seconds=4)) == records[first:]
    assert audit.read(path, since=since + timedelta(seconds=6)) == records[first + 1 :]


def test_writes_are_the_successful_changes() -> None:
    records = [record("get"), record("watch"), record("create", code=201), record("patch", code=409), record("delete")]
    assert [each["verb"] for each in audit.writes(records)] == ["create", "delete"]
