"""Watches the pods of one namespace on the way around every proxy, and keeps their history."""

import time
from collections.abc import Mapping
from typing import Any

import msgspec

from campaigns.faults.history import History, Known, Room
from campaigns.rigs.watching import Watching
from robotapp_client.api.client import ApiClient
from robotapp_client.api.resources import PODS
from robotapp_client.informer.reflector import Change, Reflector

CPU_LABEL = "cpu-milli"


class _Meta(msgspec.Struct, gc=False, rename="camel"):
    name: str = ""
    namespace: str = ""
    uid: str = ""
    resource_version: str = ""
    labels: dict[str, str] = {}


class _Spec(msgspec.Struct, gc=False, rename="camel"):
    node_name: str = ""


class _Condition(msgspec.Struct, gc=False):
    type: str
    status: str
    reason: str = ""


class _Status(msgspec.Struct, gc=False):
    conditions: list[_Condition] = []


class _Pod(msgspec.Struct, gc=False):
    metadata: _Meta
    spec: _Spec
    status: _Status


class Observer(Watching):
    """`history` is up to date with what the API server has told; `bind_s` are the moments binds were seen at."""

    def __init__(self, client: ApiClient, namespace: str, rooms: Mapping[str, Room]) -> None:
        self.history = History(rooms)
        self.bind_s: list[float] = []
        self._reflector: Reflector[Any] = Reflector(
            client, PODS, as_type=_Pod, namespace=namespace, on_change=self._take
        )
        self._lists = self._listed_at = 0

    @property
    def gaps(self) -> int:
        """How often the watch had to be replaced by a list: what happened in between has no order."""
        return max(0, self._reflector.stats.lists - 1)

    def _take(self, change: Change) -> None:
        ordered = self._ordered()
        if change.new is None:
            self.history.gone(change.old.metadata.uid)
            return
        pod = change.new
        before = self.history.binds
        known = Known(pod.metadata.name, int(pod.metadata.labels.get(CPU_LABEL, "0")), pod.spec.node_name)
        known.reported = next(
            (each.reason for each in pod.status.conditions if each.type == "PodScheduled" and each.status == "False"),
            "",
        )
        self.history.seen(pod.metadata.uid, known, ordered=ordered)
        if self.history.binds > before:
            self.bind_s.append(time.monotonic())

    def _ordered(self) -> bool:
        """Whether this change comes from a watch; the first one after a list has every node judged."""
        stats = self._reflector.stats
        if stats.lists != self._lists:
            self._lists, self._listed_at = stats.lists, stats.watches
        if stats.watches == self._listed_at:
            return False
        if self._listed_at >= 0:
            self._listed_at = -1
            self.history.settle()
        return True
