"""Bindings as the API server's audit log has them: what no client can be wrong about."""

import json
from collections import Counter
from dataclasses import dataclass, field

from robotapp_testbed import ControlPlane


@dataclass(frozen=True, slots=True)
class Counted:
    """Per pod name the bindings that were answered with success, and how many were not."""

    successes: Counter[str] = field(default_factory=Counter)
    refused: int = 0


class Bindings:
    """Reads on where the last call ended. Needs a control plane with an audit log."""

    def __init__(self, cp: ControlPlane) -> None:
        self._path = cp.logs_dir / "audit.jsonl"
        self._offset = 0

    def since_last(self) -> Counted:
        successes: Counter[str] = Counter()
        refused = 0
        with self._path.open("rb") as file:
            file.seek(self._offset)
            for line in file:
                if not line.endswith(b"\n"):
                    break
                self._offset += len(line)
                if b'"subresource":"binding"' not in line:
                    continue
                try:
                    record = json.loads(line)
                except ValueError:  # two halves where the server was killed
                    continue
                if record.get("responseStatus", {}).get("code", 500) < 300:
                    successes[record["objectRef"]["name"]] += 1
                else:
                    refused += 1
        return Counted(successes, refused)
