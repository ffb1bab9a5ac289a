"""Every change of claims and pods as the API server tells it, kept as far as the judge reads it.

A watch that ends goes on at the last revision it has seen; when the server has forgotten that revision, the campaign is
void and says so, because something may have been wrong where nobody looked.
"""

import contextlib
import http.client
import socket
import threading
from collections.abc import Mapping
from types import TracebackType
from typing import Any, Final, Self

import msgspec

from campaigns.storm.history import Event
from robotapp_api.model.names import API_VERSION
from robotapp_testbed import ControlPlane

PATHS: Final = {"RobotClaim": f"/apis/{API_VERSION}/robotclaims", "Pod": "/api/v1/pods"}
SILENCE_S: Final = 120.0
"""Bookmarks come every minute."""


class _Meta(msgspec.Struct, rename="camel", omit_defaults=True):
    name: str = ""
    namespace: str = ""
    uid: str = ""
    resource_version: str = ""
    labels: dict[str, str] = {}
    annotations: dict[str, str] = {}


class _Container(msgspec.Struct, omit_defaults=True):
    env: list[dict[str, Any]] = []


class _Spec(msgspec.Struct, rename="camel", omit_defaults=True):
    node_name: str = ""
    containers: list[_Container] = []
    holder: dict[str, str] | None = None
    domain: dict[str, Any] | None = None
    device: dict[str, Any] | None = None


class _Status(msgspec.Struct, omit_defaults=True):
    phase: str = ""


class _Kept(msgspec.Struct, omit_defaults=True):
    """Of a claim or a pod."""

    metadata: _Meta
    spec: _Spec = msgspec.field(default_factory=_Spec)
    status: _Status = msgspec.field(default_factory=_Status)
    message: str = ""


class _Line(msgspec.Struct):
    type: str
    object: _Kept


class Recorder:
    """`ripe` gives the changes of what the judge reads, `revisions` counts all. `problems`: why the record has a gap."""

    def __init__(self, cp: ControlPlane) -> None:
        self._cp = cp
        self._stop = threading.Event()
        self._threads = [
            threading.Thread(target=self._follow, args=(kind,), name=f"recorder of {kind}", daemon=True)
            for kind in PATHS
        ]
        self._connections: dict[str, http.client.HTTPSConnection] = {}
        self._last: dict[str, dict[str, Any]] = {}
        self._claims: set[str] = set()
        self._holders: dict[str, str] = {}
        """Name of the holder by uid of the claim."""
        self._versions: dict[str, str] = {}
        self._events: list[Event] = []
        self._lock = threading.Lock()
        self.revisions = 0
        self.problems: list[str] = []

    def __enter__(self) -> Self:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop.set()
        for connection in self._connections.values():
            with contextlib.suppress(OSError, AttributeError):  # closed already
                connection.sock.shutdown(socket.SHUT_RDWR)
        for thread in self._threads:
            thread.join(timeout=10)

    @property
    def claims(self) -> int:
        """Claims seen so far."""
        return len(self._claims)

    @property
    def passed(self) -> dict[str, int]:
        """The revision that each watch has passed, by kind; without a kind whose watch has not begun."""
        return {kind: int(version) for kind, version in self._versions.copy().items()}

    def ripe(self, *, all_of_them: bool = False) -> list[Event]:
        """What happened since the last call, up to the revision that both watches have passed; each event comes once."""
        with self._lock:
            past = min((int(self._versions.get(kind, 0)) for kind in PATHS), default=0)
            found = [event for event in self._events if all_of_them or event.revision <= past]
            self._events = [event for event in self._events if not (all_of_them or event.revision <= past)]
        return found

    def holders(self) -> frozenset[str]:
        """Names of the apps and pods that hold something now."""
        return frozenset(self._holders.copy().values())

    def _follow(self, kind: str) -> None:
        self._versions[kind] = str(self._cp.api.get(f"{PATHS[kind]}?limit=1")["metadata"]["resourceVersion"])
        while not self._stop.is_set() and not self.problems:
            try:
                self._watch(kind)
            except (OSError, ValueError, http.client.HTTPException):
                self._stop.wait(0.2)  # the server closed it, or we did

    def _watch(self, kind: str) -> None:
        since = f"timeoutSeconds=86400&resourceVersion={self._versions[kind]}"
        path = f"{PATHS[kind]}?watch=1&allowWatchBookmarks=true&{since}"
        connection = self._connections[kind] = self._cp.api.stream(path, silence_s=SILENCE_S)
        with contextlib.closing(connection), connection.getresponse() as response:
            if response.status == http.HTTPStatus.GONE:
                self._gap(kind, response.read().decode())
            while response.status == http.HTTPStatus.OK and (line := response.readline()):
                found = msgspec.json.decode(line, type=_Line)
                if found.type == "ERROR":
                    self._gap(kind, found.object.message)
                    return
                if found.type != "BOOKMARK":
                    self._note(kind, found)
                self._versions[kind] = found.object.metadata.resource_version

    def _gap(self, kind: str, why: str) -> None:
        self.problems.append(f"the record of {kind}s has a gap after {self._versions[kind]}: {why}")

    def _note(self, kind: str, found: _Line) -> None:
        self.revisions += 1
        obj: dict[str, Any] = msgspec.to_builtins(found.object)
        obj.setdefault("spec", {})
        obj.setdefault("status", {})
        revision = int(obj["metadata"].pop("resourceVersion"))
        uid, gone = obj["metadata"]["uid"], found.type == "DELETED"
        if kind == "RobotClaim":
            self._note_claim(uid, obj, gone=gone)
        if gone:
            self._last.pop(uid, None)
        elif self._last.get(uid) == obj:
            return
        else:
            self._last[uid] = obj
        with self._lock:
            self._events.append(Event(revision, kind, gone, obj))

    def _note_claim(self, uid: str, claim: Mapping[str, Any], *, gone: bool) -> None:
        self._claims.add(uid)
        if gone:
            self._holders.pop(uid, None)
        else:
            self._holders[uid] = claim["spec"]["holder"]["name"]
