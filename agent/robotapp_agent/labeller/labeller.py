"""Keeps the labels hardware.robotics.io/* of all nodes true to NodeTelemetry, by server-side apply as a manager of its own.

What this manager applied and no longer applies, the API server removes; what others set, it leaves alone.
"""

import asyncio
import contextlib
import logging
from collections.abc import Iterator
from typing import Final

import msgspec

from robotapp_agent.devices.device import Device
from robotapp_agent.devices.labels import labels_of
from robotapp_agent.labeller.wanted import Wanted, free_of, keys_of_causes
from robotapp_api.model.names import HARDWARE_PREFIX, EventReason
from robotapp_client.api.backoff import Backoff
from robotapp_client.api.client import ApiClient
from robotapp_client.api.resources import NODES, NODETELEMETRIES
from robotapp_client.informer.reflector import Change, Reflector
from robotapp_client.tools.event_recorder import EventRecorder, reference
from robotapp_client.transport.errors import ClientError, Conflict

log = logging.getLogger(__name__)

MANAGER: Final = "robotapp-labeller"
AGAIN_S: Final = 1.0
"""After a refusal that names other owners: by then the watch has brought what they set."""
LONGEST_S: Final = 60.0


class _Metadata(msgspec.Struct, rename="camel", frozen=True, gc=False):
    name: str
    uid: str = ""
    resource_version: str = ""
    labels: dict[str, str] | None = None


class Node(msgspec.Struct, frozen=True, gc=False):
    """The metadata of a node."""

    metadata: _Metadata

    @property
    def hardware(self) -> dict[str, str]:
        """Its labels of devices, from all writers."""
        labels = self.metadata.labels or {}
        return {key: value for key, value in labels.items() if key.startswith(HARDWARE_PREFIX)}


class _Status(msgspec.Struct, frozen=True, gc=False):
    devices: list[Device] | None = None


class Telemetry(msgspec.Struct, frozen=True, gc=False):
    """The devices of a NodeTelemetry."""

    metadata: _Metadata
    status: _Status = _Status()


class _State:
    """What is known of one node: `applied` is None before the first write of this process."""

    def __init__(self, kept_s: float) -> None:
        self.wanted = Wanted(kept_s=kept_s)
        self.applied: dict[str, str] | None = None
        self.taken: dict[str, str] = {}
        self.backoff = Backoff(base_s=AGAIN_S, cap_s=LONGEST_S)


class Labeller:
    """`client` writes, `heads` watches the metadata of nodes. Labels that others have set are told as events of their node."""

    def __init__(self, client: ApiClient, heads: ApiClient, *, recorder: EventRecorder, kept_s: float) -> None:
        self._client = client
        self._recorder = recorder
        self._kept_s = kept_s
        self._telemetry = Reflector(client, NODETELEMETRIES, as_type=Telemetry, on_change=self._on_telemetry)
        self._nodes = Reflector(heads, NODES, as_type=Node, on_change=self._on_node)
        self._states: dict[str, _State] = {}
        self._due_s: dict[str, float] = {}
        self._woken = asyncio.Event()

    def __repr__(self) -> str:
        return f"<Labeller: {len(self._states)} nodes, {len(self._due_s)} of them due>"

    async def run(self) -> None:
        """Until cancelled."""
        async with asyncio.TaskGroup() as group:
            group.create_task(self._telemetry.run())
            group.create_task(self._nodes.run())
            # Before that a node without telemetry could be one whose telemetry has not come yet.
            await self._telemetry.synced.wait()
            await self._nodes.synced.wait()
            while True:
                for name in list(self._ready()):
                    await self._write(name)
                await self._wait()

    def _on_telemetry(self, change: Change) -> None:
        devices = change.new.status.devices or () if change.new else ()
        self._state(change.key).wanted.update(labels_of(devices), now_s=self._client.clock())
        self._wake(change.key)

    def _on_node(self, change: Change) -> None:
        if change.new is None:
            self._states.pop(change.key, None)
            self._due_s.pop(change.key, None)
        elif change.old is None or change.old.hardware != change.new.hardware:
            self._wake(change.key)

    def _state(self, name: str) -> _State:
        return self._states.setdefault(name, _State(self._kept_s))

    def _wake(self, name: str, *, in_s: float = 0.0) -> None:
        at_s = self._client.clock() + in_s
        self._due_s[name] = min(at_s, self._due_s.get(name, at_s))
        self._woken.set()

    def _ready(self) -> Iterator[str]:
        now_s = self._client.clock()
        for name in [name for name, due_s in self._due_s.items() if due_s <= now_s]:
            del self._due_s[name]
            yield name

    async def _wait(self) -> None:
        """Until a change, or the next moment at which something is due."""
        next_s = min(self._due_s.values(), default=None)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(None if next_s is None else max(0.0, next_s - self._client.clock())):
                await self._woken.wait()
        self._woken.clear()

    async def _write(self, name: str) -> None:
        node = self._nodes.store.get(name)
        if node is None:
            return
        state = self._state(name)
        wanted = state.wanted.at(self._client.clock())
        if state.wanted.due_s is not None:
            self._wake(name, in_s=state.wanted.due_s - self._client.clock())
        labels = free_of(wanted, on_node=node.hardware, taken=state.taken)
        if not _differs(state, node, labels):
            return
        metadata = {"name": name, "uid": node.metadata.uid, "labels": labels}
        try:
            await self._client.apply(NODES, {"metadata": metadata}, force=False)
        except Conflict as error:
            self._refused(name, node, labels, error)
        except ClientError as error:
            wait_s = state.backoff.next_s()
            log.warning("labels of node %s are not written, again in %.0f s: %s", name, wait_s, error)
            self._wake(name, in_s=wait_s)
        else:
            state.backoff.reset()
            if labels != state.applied:
                log.info("node %s has %d labels of its devices", name, len(labels))
            state.applied = labels

    def _refused(self, name: str, node: Node, labels: dict[str, str], error: Conflict) -> None:
        """Leave to their owners what others have set; a conflict about anything else is tried again."""
        state = self._state(name)
        keys = keys_of_causes(error.causes, labels)
        if not keys:
            log.warning("labels of node %s are not written, they are tried again: %s", name, error)
        for key in keys:
            value = node.hardware.get(key, "")
            if state.taken.get(key) != value:
                self._tell_taken(node, key, value, wanted=labels[key])
            state.taken[key] = value
        self._wake(name, in_s=AGAIN_S if keys else state.backoff.next_s())

    def _tell_taken(self, node: Node, key: str, value: str, *, wanted: str) -> None:
        name = node.metadata.name
        text = (
            f"label {key}={value} of node {name} was set by another writer and stays; the node's devices give {wanted}. "
            f"To have it follow them, remove it: kubectl label node {name} {key}-"
        )
        log.warning("%s", text)
        about = reference(api_version="v1", kind="Node", name=name, uid=node.metadata.uid)
        self._recorder.event(about, reason=EventReason.LABEL_TAKEN, note=text, action="Label", warning=True)


def _differs(state: _State, node: Node, labels: dict[str, str]) -> bool:
    """Whether a write would change anything. The first one of this process also removes what an earlier process left."""
    if state.applied is None:
        return bool(labels or node.hardware)
    return labels != state.applied or any(node.hardware.get(key) != value for key, value in labels.items())
