import json
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
import yaml

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


def test_no_log_yet_means_no_records(tmp_path: Path) -> None:
    assert audit.read(tmp_path / "none") == []


def test_writes_are_the_successful_changes() -> None:
    records = [record("get"), record("watch"), record("create", code=201), record("patch", code=409), record("delete")]
    assert [each["verb"] for each in audit.writes(records)] == ["create", "delete"]


def test_writes_can_be_narrowed_to_a_user_and_a_resource() -> None:
    records = [record("create", user="a"), record("create", user="b"), record("create", user="a", resource="nodes")]
    assert audit.writes(records, user="a", resource="pods") == [records[0]]


def test_a_record_without_an_object_is_no_write_of_a_resource() -> None:
    bare = {"verb": "create", "responseStatus": {"code": 201}, "user": {"username": "a"}}
    assert audit.writes([bare]) == [bare]
    assert audit.writes([bare], resource="pods") == []


def test_the_policy_has_one_record_per_request() -> None:
    policy = yaml.safe_load(audit.policy("Metadata"))
    assert policy["omitStages"] == ["RequestReceived"]
    assert policy["rules"] == [{"level": "Metadata"}]
