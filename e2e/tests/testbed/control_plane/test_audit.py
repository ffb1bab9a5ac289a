import json
from pathlib import Path
from typing import Any

from robotapp_testbed.control_plane import audit


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


def test_writes_are_the_successful_changes() -> None:
    records = [record("get"), record("watch"), record("create", code=201), record("patch", code=409), record("delete")]
    assert [each["verb"] for each in audit.writes(records)] == ["create", "delete"]
