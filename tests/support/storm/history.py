"""Every state of claims and pods that ever was, replayed in the order of the store's revisions, and what broke a rule in it.

Revisions are the same counter for all kinds, so events of two watches merge into one exact order.
"""

import json
import subprocess
import threading
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any, Self

from tests.support.invariants import Object, broken_rules, things_of

from robotapp_testbed import ControlPlane

_ENDED = {"Succeeded", "Failed"}


@dataclass(frozen=True, slots=True, order=True)
class Event:
    """One change of one object; `revision` is that of the store after it."""

    revision: int
    kind: str
    gone: bool
    obj: Mapping[str, Any] = field(compare=False)

    @property
    def uid(self) -> str:
        return str(self.obj["metadata"]["uid"])


@dataclass(slots=True)
class Verdict:
    """`grants`: claims made. `broken`: revision and rule, in words."""

    grants: int = 0
    revisions: int = 0
    broken: list[str] = field(default_factory=list)


def judge(events: Iterable[Event], *, namespaces: set[str]) -> Verdict:
    """Replay; at every revision no thing has two users, and what runs in our namespaces is backed by its claim."""
    found, state = Verdict(), _State(namespaces)
    for event in sorted(events):
        found.revisions += 1
        found.grants += event.kind == "RobotClaim" and state.is_new(event)
        state.apply(event)
        for text in state.broken_by(event):
            found.broken.append(f"revision {event.revision}: {text}")
    return found


class _State:
    """Claims and pods as of one revision, by what they are about, so that a change is judged with its neighbours alone."""

    def __init__(self, namespaces: set[str]) -> None:
        self._namespaces = namespaces
        self._claims: dict[str, Object] = {}
        self._pods: dict[str, Object] = {}
        self._users: defaultdict[str, set[str]] = defaultdict(set)
        """Names of the pods' things -> uids of the pods."""

    def is_new(self, event: Event) -> bool:
        return not event.gone and event.uid not in self._claims

    def apply(self, event: Event) -> None:
        table = self._claims if event.kind == "RobotClaim" else self._pods
        before = table.pop(event.uid, None)
        if event.kind == "Pod":
            for thing in _things(before):
                self._users[thing].discard(event.uid)
        if event.gone:
            return
        table[event.uid] = event.obj
        if event.kind == "Pod" and event.obj["metadata"]["namespace"] in self._namespaces:
            for thing in _things(event.obj):
                self._users[thing].add(event.uid)

    def broken_by(self, event: Event) -> list[str]:
        """The rules that are broken around the things this event is about."""
        things = _names_of(event.obj) if event.kind == "RobotClaim" else set(_things(event.obj))
        pods = [self._pods[uid] for thing in things for uid in self._users.get(thing, ())]
        if not pods:
            return []
        concerned = {name for pod in pods for name in _things(pod)}
        claims = [claim for claim in self._claims.values() if _names_of(claim) & concerned]
        return broken_rules(claims, {pod["metadata"]["uid"]: pod for pod in pods}.values())


def _things(pod: Object | None) -> list[str]:
    if pod is None or pod["status"].get("phase") in _ENDED or not pod["spec"].get("nodeName"):
        return []
    return things_of(pod)


def _names_of(claim: Object) -> set[str]:
    device, domain = claim["spec"].get("device"), claim["spec"].get("domain")
    if device:
        return {f"{device['node']}/{device['id']}"}
    return {claim["metadata"]["name"], str(domain["id"])} if domain else set()


class Recorder:
    """Two watches with every event as the API server sends it."""

    def __init__(self, cp: ControlPlane) -> None:
        self._cp = cp
        self._processes: list[subprocess.Popen[str]] = []
        self._threads: list[threading.Thread] = []
        self.events: list[Event] = []
        self._claims: set[str] = set()
        self._lock = threading.Lock()

    def __enter__(self) -> Self:
        for kind, resource in (("RobotClaim", "robotclaims"), ("Pod", "pods")):
            argv = [
                str(self._cp.run_dir / "bin" / "kubectl"),
                f"--kubeconfig={self._cp.kubeconfig()}",
                "get",
                resource,
                "-A",
                "-w",
                "--output-watch-events",
                "-o",
                "json",
            ]
            process = subprocess.Popen(argv, stdout=subprocess.PIPE, text=True)
            thread = threading.Thread(target=self._read, args=(kind, process), daemon=True)
            thread.start()
            self._processes.append(process)
            self._threads.append(thread)
        return self

    @property
    def claims(self) -> int:
        """Claims seen so far."""
        return len(self._claims)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for process in self._processes:
            process.terminate()
            process.wait()
        for thread in self._threads:
            thread.join()

    def _read(self, kind: str, process: "subprocess.Popen[str]") -> None:
        assert process.stdout is not None
        for found in documents(iter(lambda: process.stdout.read(1 << 14), "")):  # type: ignore[union-attr]
            obj = found["object"]
            event = Event(int(obj["metadata"]["resourceVersion"]), kind, found["type"] == "DELETED", obj)
            with self._lock:
                self.events.append(event)
                if kind == "RobotClaim":
                    self._claims.add(event.uid)


def documents(chunks: Iterable[str]) -> Iterator[Any]:
    """JSON documents that follow one another without a separator; the rest of a cut one is dropped."""
    decoder, rest = json.JSONDecoder(), ""
    for chunk in chunks:
        rest = (rest + chunk).lstrip()
        while rest:
            try:
                found, end = decoder.raw_decode(rest)
            except json.JSONDecodeError:
                break
            yield found
            rest = rest[end:].lstrip()
