"""The API server's audit log: which identity wrote what, in the order the server saw it."""

import json
import os
from bisect import bisect_left
from collections.abc import Iterable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import IO, Any, Final

import yaml

WRITE_VERBS = frozenset({"create", "update", "patch", "delete", "deletecollection"})
_DISORDER: Final = timedelta(seconds=5)
"""Requests that end at about the same time may be recorded in another order."""


def policy(level: str) -> str:
    """An audit policy with one finished record per request at `level` (Metadata, Request or RequestResponse)."""
    return yaml.safe_dump(
        {
            "apiVersion": "audit.k8s.io/v1",
            "kind": "Policy",
            "omitStages": ["RequestReceived"],
            "rules": [{"level": level}],
        }
    )


def read(path: Path, *, since: datetime | None = None) -> list[dict[str, Any]]:
    """Returns the complete records; a last line the server is still writing is left out.

    since: only what ended after it, and some of what ended a few seconds before. The log of a session has a hundred MB.
    """
    if not path.exists():
        return []
    with path.open("rb") as file:
        size = file.seek(0, os.SEEK_END)
        _seek_line(file, 0 if since is None else bisect_left(range(size), since - _DISORDER, key=_EndTimes(file)))
        text = file.read()
    return [json.loads(line) for line in text[: text.rfind(b"\n") + 1].splitlines()]


class _EndTimes:
    """When the request ended whose record is the first to begin at or behind an offset; never, behind the last one."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file

    def __call__(self, offset: int) -> datetime:
        _seek_line(self._file, offset)
        line = self._file.readline()
        if not line.endswith(b"\n"):
            return datetime.max.replace(tzinfo=UTC)
        return datetime.fromisoformat(json.loads(line)["stageTimestamp"])


def _seek_line(file: IO[bytes], offset: int) -> None:
    """Moves to the first line that begins at or behind `offset`."""
    file.seek(max(0, offset - 1))
    if offset:
        file.readline()


def writes(
    records: Iterable[dict[str, Any]], *, user: str | None = None, resource: str | None = None
) -> list[dict[str, Any]]:
    """The successful writes among `records`, optionally of one user name and one resource (plural)."""
    return [
        record
        for record in records
        if record["verb"] in WRITE_VERBS
        and record.get("responseStatus", {}).get("code", 500) < 300
        and (user is None or record["user"]["username"] == user)
        and (resource is None or record.get("objectRef", {}).get("resource") == resource)
    ]
