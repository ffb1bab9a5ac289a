"""Writes the own node's NodeTelemetry: creates it when it is absent, and patches its status."""

import time
from collections.abc import Callable
from typing import Any, Final, NamedTuple

import msgspec

from robotapp_agent.devices.device import Device
from robotapp_agent.report.clock_offset import ClockOffset
from robotapp_agent.report.status import SECTIONS, Status, patch_of, without
from robotapp_agent.shell.own_node import OwnNode
from robotapp_client.api.bodies import MERGE
from robotapp_client.api.client import ApiClient, with_query
from robotapp_client.api.resources import NODETELEMETRIES
from robotapp_client.transport.errors import AlreadyExists, Invalid, NotFound, means_gone
from robotapp_client.transport.http_transport import Response

MANAGER: Final = "robotapp-agent"
MOST_ASKED: Final = 16
REFUSED_S: Final = 600.0
"""How long a part of the status that the API server refused is left out."""


class _Spec(msgspec.Struct):
    probe: list[str] | None = None


class _Stored(msgspec.Struct):
    """What we read of our object."""

    spec: _Spec = msgspec.field(default_factory=_Spec)


class _StoredStatus(msgspec.Struct):
    seq: int | None = None
    devices: list[Device] | None = None


class _Earlier(msgspec.Struct):
    status: _StoredStatus = msgspec.field(default_factory=_StoredStatus)


class Earlier(NamedTuple):
    """What the agent left in its object before it was started again."""

    seq: int = 0
    devices: tuple[Device, ...] = ()


_STORED: Final = msgspec.json.Decoder(_Stored)
_EARLIER: Final = msgspec.json.Decoder(_Earlier)


class ApiWriter:
    """One node's object. `node` is called before each creation: the uid in the token is that of the living Node.

    `offset` learns the API server's time from each answer.
    """

    def __init__(
        self,
        client: ApiClient,
        node: Callable[[], OwnNode],
        *,
        offset: ClockOffset,
        wall: Callable[[], float] = time.time,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._client = client
        self._node = node
        self._offset = offset
        self._wall = wall
        self._clock = clock
        self._refused_until_s: dict[str, float] = {}
        self.refused = ""
        """What the API server last said of a part that is left out, "" while nothing is."""

    def __repr__(self) -> str:
        return f"<ApiWriter, left out: {', '.join(self._refused_until_s) or 'nothing'}>"

    async def earlier(self) -> Earlier:
        """What the object holds now; nothing when there is none. Raises ClientError."""
        path = NODETELEMETRIES.path(None, self._node().name)
        try:
            status = (await self._client.read(path, _EARLIER.decode)).status
        except (NotFound, msgspec.ValidationError):
            return Earlier()
        return Earlier(status.seq or 0, tuple(status.devices or ()))

    async def write(self, status: Status) -> tuple[str, ...]:
        """Write the status. Returns the nodes that `spec.probe` asks for. Raises ClientError."""
        name = self._node().name
        try:
            return await self._patch(name, status)
        except NotFound as error:
            if not means_gone(error, name):
                raise
            await self._create()
            return await self._patch(name, status)

    async def _patch(self, name: str, status: Status) -> tuple[str, ...]:
        path = with_query(NODETELEMETRIES.path(None, name, "status"), {"fieldManager": MANAGER})
        try:
            return await self._sent(path, without(status, self._left_out()))
        except Invalid as error:
            refused = {
                field.split(".")[1].partition("[")[0] for field, _, _ in error.causes if field.startswith("status.")
            }
            if not refused & SECTIONS or refused <= self._refused_until_s.keys():
                raise
            self._refused_until_s |= dict.fromkeys(refused & SECTIONS, self._clock() + REFUSED_S)
            self.refused = str(error)
        return await self._sent(path, without(status, self._left_out()))

    async def _sent(self, path: str, status: Status) -> tuple[str, ...]:
        sent_s, began_s = self._wall(), self._clock()
        response = await self._client.request("PATCH", path, patch_of(status), MERGE)
        took_s = self._clock() - began_s
        self._learn_time(response, sent_s, took_s)
        return _asked(response)

    def _learn_time(self, response: Response, sent_s: float, took_s: float) -> None:
        received_s = self._wall()
        if abs(received_s - sent_s - took_s) < 0.5:  # else the clock was set meanwhile
            date = response.headers.get("Date", "")
            self._offset.answered(date, sent_ms=int(sent_s * 1000), received_ms=int(received_s * 1000))

    def _left_out(self) -> frozenset[str]:
        now_s = self._clock()
        self._refused_until_s = {name: until_s for name, until_s in self._refused_until_s.items() if until_s > now_s}
        if not self._refused_until_s:
            self.refused = ""
        return frozenset(self._refused_until_s)

    async def _create(self) -> None:
        node = self._node()
        metadata: dict[str, Any] = {"name": node.name}
        if node.uid:
            metadata["ownerReferences"] = [{"apiVersion": "v1", "kind": "Node", "name": node.name, "uid": node.uid}]
        try:
            await self._client.create(NODETELEMETRIES, {"metadata": metadata})
        except AlreadyExists:  # by an answer that did not reach us, or by an agent that is about to end
            return


def _asked(response: Response) -> tuple[str, ...]:
    """spec.probe of the answer; an answer that cannot be read asks for nothing."""
    try:
        return tuple(_STORED.decode(response.body).spec.probe or ())[:MOST_ASKED]
    except msgspec.DecodeError:
        return ()
