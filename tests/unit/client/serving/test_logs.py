"""Log lines."""

import json
import logging
import sys

from robotapp_client.serving.logs import JsonLines


def record(message: str, *args: object, **extra: object) -> logging.LogRecord:
    found = logging.LogRecord("robotapp_scheduler.x", logging.WARNING, "x.py", 1, message, args, None)
    found.__dict__.update(extra)
    return found


def test_a_line_is_one_json_object_with_the_records_fields() -> None:
    line = json.loads(JsonLines().format(record("%s is late", "edge-1", fields={"status": 503})))
    assert (line["message"], line["level"], line["logger"]) == ("edge-1 is late", "warning", "robotapp_scheduler.x")
    assert line["status"] == 503
    assert line["time"].endswith("Z")


def test_an_exception_keeps_its_stack_on_the_same_line() -> None:
    try:
        int("boom")
    except ValueError:
        found = record("failed", exc_info=sys.exc_info())
    text = JsonLines().format(found)
    assert "\n" not in text
    assert "ValueError: invalid literal" in json.loads(text)["stack"]
