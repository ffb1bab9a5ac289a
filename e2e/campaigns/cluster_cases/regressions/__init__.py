"""Cases that once showed a difference, one JSON file each, made small: `{"why": …, "profile": …, "objects": […]}`.

They are compared with the reference by every `scripts/test` and with kube-scheduler by every `scripts/bench parity`.
"""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from campaigns.cluster_cases.case import Case

Json = dict[str, Any]
FOLDER = Path(__file__).parent
FAMILY = "regression"


@dataclass(frozen=True, slots=True)
class Regression:
    """why: what differed, in a few words. profile: the suffix of the profile that decides."""

    name: str
    why: str
    objects: tuple[Json, ...]
    profile: str = ""

    @property
    def case(self) -> Case:
        return Case((FAMILY,), self.objects)


def regressions(folder: Path = FOLDER) -> list[Regression]:
    """All that are kept, by name."""
    found = []
    for path in sorted(folder.glob("*.json")):
        document = json.loads(path.read_text())
        found.append(Regression(path.stem, document["why"], tuple(document["objects"]), document["profile"]))
    return found


def keep(objects: Sequence[Json], *, why: str, profile: str = "", folder: Path = FOLDER) -> Path:
    """Write a case to the folder, under a name made of its content."""
    document = {"why": why, "profile": profile, "objects": list(objects)}
    text = json.dumps(document, indent=1) + "\n"
    path = folder / f"{hashlib.sha256(text.encode()).hexdigest()[:10]}.json"
    path.write_text(text)
    return path
