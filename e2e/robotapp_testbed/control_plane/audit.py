"""The API server's audit log: which identity wrote what, in the order the server saw it."""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import yaml

WRITE_VERBS = frozenset({"create", "update", "patch", "delete", "deletecollection"})


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


def read(path: Path) -> list[dict[str, Any]]:
    """All complete records; a last line the server is still writing is left out."""
    if not path.exists():
        return []
    text = path.read_text()
    return [json.loads(line) for line in text[: text.rfind("\n") + 1].splitlines()]


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
