"""Every change of the Jobs of a namespace, and what did not hold in it: room of the queue, and who decides about `suspend`."""

import contextlib
import http
import http.client
import json
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from campaigns.common.background import Background
from robotapp_testbed import ControlPlane

Json = dict[str, Any]
SILENCE_S: Final = 30.0
_ENDED: Final = frozenset({"Complete", "Failed"})


@dataclass(frozen=True, slots=True)
class JobChange:
    """One state of one Job."""

    revision: int
    name: str
    uid: str
    is_suspended: bool
    has_ended: bool
    is_gone: bool = False


def read_change(event: Mapping[str, Any]) -> JobChange:
    """Reads an event of a watch."""
    job = event["object"]
    conditions = job.get("status", {}).get("conditions", [])
    return JobChange(
        revision=int(job["metadata"]["resourceVersion"]),
        name=job["metadata"]["name"],
        uid=job["metadata"]["uid"],
        is_suspended=bool(job["spec"].get("suspend")),
        has_ended=any(item["type"] in _ENDED and item["status"] == "True" for item in conditions),
        is_gone=event["type"] == "DELETED",
    )


@dataclass(slots=True)
class Verdict:
    """`turns`: by Job, each value of `suspend` that it had, in order, from its creation to its end."""

    most_at_once: int = 0
    turns: dict[str, list[bool]] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)


def judge(changes: Iterable[JobChange], room: int) -> Verdict:
    """Judges that no more Jobs ran at once than the queue has room for, and that each was created suspended. Pure."""
    verdict = Verdict()
    turns: dict[str, list[bool]] = defaultdict(list)
    names: dict[str, str] = {}
    job_uids: set[str] = set()
    for change in sorted(changes, key=lambda item: item.revision):
        names[change.uid] = change.name
        if change.is_gone or change.has_ended or change.is_suspended:
            job_uids.discard(change.uid)
        else:
            job_uids.add(change.uid)
        if len(job_uids) > max(verdict.most_at_once, room):
            verdict.problems.append(
                f"revision {change.revision}: {len(job_uids)} Jobs run, the queue has room for {room}"
            )
        verdict.most_at_once = max(verdict.most_at_once, len(job_uids))
        if not (change.is_gone or change.has_ended) and turns[change.uid][-1:] != [change.is_suspended]:
            turns[change.uid].append(change.is_suspended)
    verdict.problems += [
        f"{names[uid]} was created without being suspended" for uid, values in turns.items() if values[:1] == [False]
    ]
    verdict.turns = {f"{names[uid]} ({uid[:8]})": values for uid, values in turns.items()}
    return verdict


class JobHistory(Background):
    """Follows the Jobs of a namespace while it is entered; `changes` has all of their states."""

    def __init__(self, cp: ControlPlane, namespace: str) -> None:
        self._cp = cp
        self._path = f"/apis/batch/v1/namespaces/{namespace}/jobs"
        self._version = str(cp.api.get(self._path)["metadata"]["resourceVersion"])
        self.changes: list[JobChange] = []
        super().__init__("job history")

    def _run(self) -> None:
        while not self._stop.is_set():
            # A short watch after the other: each begins where the last one has ended, and the end is near when asked to stop.
            path = f"{self._path}?watch=1&timeoutSeconds=1&allowWatchBookmarks=true&resourceVersion={self._version}"
            connection = self._cp.api.stream(path, silence_s=SILENCE_S)
            with contextlib.closing(connection), connection.getresponse() as response:
                if response.status != http.HTTPStatus.OK:
                    raise RuntimeError(f"the watch of Jobs ended: {response.read().decode()}")
                self._read(response)

    def _read(self, response: http.client.HTTPResponse) -> None:
        while line := response.readline():
            event = json.loads(line)
            if event["type"] == "ERROR":
                raise RuntimeError(f"the record of Jobs has a gap after {self._version}: {event['object']}")
            self._version = event["object"]["metadata"]["resourceVersion"]
            if event["type"] != "BOOKMARK":
                self.changes.append(read_change(event))
