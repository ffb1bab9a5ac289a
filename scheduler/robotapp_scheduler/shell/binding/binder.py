"""Binds one pod to one node with a Binding that takes effect at most once, and finds out whether it did.

The Binding carries the pod's uid, so that a pod re-created under the same name is never bound by mistake, and the
grants as annotations: the API server merges them into the pod in the same write that sets nodeName. A bind that hands
out grants also carries the resourceVersion read before the claims were made (claims.md).
Nothing here deletes a claim: after a lost reply the pod may be bound.
"""

import asyncio
import itertools
import random
from collections.abc import Awaitable, Callable, Mapping
from typing import Any

import msgspec

from robotapp_client.api.client import ApiClient
from robotapp_client.api.resources import PODS
from robotapp_client.transport.errors import (
    ApiError,
    ClientError,
    Conflict,
    NamespaceTerminating,
    NotFound,
    ServerError,
    TooManyRequests,
    means_gone,
)
from robotapp_client.transport.http11 import Permitted, always
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.framework.handle import BindOutcome, BindResult

TRIES = 4
FIRST_DELAY_S = 0.01
DELAY_FACTOR = 5.0
JITTER = 0.1
"""Retry policy of kube-scheduler 1.37: 4 tries, 10 ms, each delay five times the last, 10 % jitter."""
MOST_DOUBT_DELAY_S = 2.0
"""Longest pause between two reads of a pod whose bind may have been applied."""


class Binder:
    """Posts Bindings and finds out what became of them."""

    def __init__(
        self,
        client: ApiClient,
        *,
        permitted: Permitted = always,
        sleep: Callable[[float], Awaitable[None]] = asyncio.sleep,
        uniform: Callable[[], float] = random.random,
    ) -> None:
        """`permitted` is called before every request: whether this process still holds the lease."""
        self._client = client
        self._permitted = permitted
        self._sleep = sleep
        self._uniform = uniform
        self._encoder = msgspec.json.Encoder()

    def send(
        self,
        pod: Pod,
        node: str,
        done: Callable[[ClientError | None], None],
        *,
        annotations: Mapping[str, str] | None = None,
        resource_version: str = "",
    ) -> None:
        """As `core.framework.handle.Pods` has it, with grants, too."""
        path, body = self._binding(pod, node, annotations, resource_version)
        self._client.post_soon(path, body, done, permitted=self._permitted)

    async def bind(
        self,
        pod: Pod,
        node: str,
        *,
        annotations: Mapping[str, str] | None = None,
        resource_version: str = "",
        refused: Exception | None = None,
    ) -> BindOutcome:
        """As `core.framework.handle.Pods` has it. Never raises for anything the API server or the network may do."""
        first = refused if isinstance(refused, ClientError) else None
        path, body = self._binding(pod, node, annotations, resource_version)
        problem, in_doubt = "", False
        for attempt in range(TRIES):
            if attempt:
                await self._sleep(self._delay_s(attempt))
            if not self._permitted() and (attempt or first is None):
                return BindOutcome(BindResult.DEPOSED)
            error = first if attempt == 0 and first is not None else await self._post(path, body)
            if error is None:
                return BindOutcome(BindResult.BOUND, node=node)
            problem = str(error)
            if isinstance(error, TooManyRequests):
                await self._sleep(error.pause_s)
            elif isinstance(error, Conflict | NotFound):
                return await self._read_back(pod, node, problem=problem, in_doubt=in_doubt)
            elif isinstance(error, ServerError):
                in_doubt = True
                if error.status not in {500, 503}:
                    return await self._read_back(pod, node, problem=problem, in_doubt=True)
            elif isinstance(error, NamespaceTerminating):  # nothing is ever bound there again, and the pod goes with it
                return BindOutcome(BindResult.GONE, problem)
            elif isinstance(error, ApiError):
                return BindOutcome(BindResult.FAILED, problem)
            elif error.maybe_applied:
                return await self._read_back(pod, node, problem=problem, in_doubt=True)
        return await self._read_back(pod, node, problem=problem, in_doubt=in_doubt)

    async def _post(self, path: str, body: bytes) -> ClientError | None:
        try:
            await self._client.post_raw(path, body, permitted=self._permitted)
        except ClientError as error:
            return error
        return None

    def _binding(
        self, pod: Pod, node: str, annotations: Mapping[str, str] | None, resource_version: str
    ) -> tuple[str, bytes]:
        """Path and body of the request."""
        meta = pod.metadata
        metadata: dict[str, Any] = {"name": meta.name, "namespace": meta.namespace, "uid": meta.uid}
        if resource_version:
            metadata["resourceVersion"] = resource_version
        if annotations:
            metadata["annotations"] = annotations
        target = {"apiVersion": "v1", "kind": "Node", "name": node}
        body = self._encoder.encode({"apiVersion": "v1", "kind": "Binding", "metadata": metadata, "target": target})
        return PODS.path(meta.namespace, meta.name, "binding"), body

    async def _read_back(self, pod: Pod, node: str, *, problem: str, in_doubt: bool) -> BindOutcome:
        """Read the pod after an unclear reply: the only way to know whether the bind took effect.

        While it may have (`in_doubt`) the pod is read until the API server replies, however long that takes: if the room on
        the node were given to another pod meanwhile, the node could be filled twice.
        """
        for attempt in itertools.count():
            if attempt:
                if attempt >= TRIES and not in_doubt:
                    break
                await self._sleep(min(self._delay_s(attempt), MOST_DOUBT_DELAY_S))
            if not self._permitted():
                return BindOutcome(BindResult.DEPOSED)
            try:
                found = await self._client.get(PODS, pod.metadata.name, namespace=pod.metadata.namespace, as_type=Pod)
            except ClientError as error:
                if isinstance(error, NotFound) and means_gone(error, pod.metadata.name):
                    return BindOutcome(BindResult.GONE, problem)
                problem = f"{problem}; reading the pod: {error}" if attempt == 0 else problem
                continue
            return judge(found, pod, node, problem=problem)
        return BindOutcome(BindResult.FAILED, problem)

    def _delay_s(self, attempt: int) -> float:
        step = min(attempt, 2 * TRIES) - 1
        return FIRST_DELAY_S * DELAY_FACTOR**step * (1 + JITTER * self._uniform())


def judge(found: Pod, wanted: Pod, node: str, *, problem: str) -> BindOutcome:
    """The outcome of our bind of `wanted` to `node`, judged by the pod as stored now."""
    if found.metadata.uid != wanted.metadata.uid:
        return BindOutcome(BindResult.GONE, problem)
    if found.spec.node_name == node:
        return BindOutcome(BindResult.BOUND, node=node)
    if found.metadata.deletion_timestamp:
        return BindOutcome(BindResult.GONE, problem)
    if found.spec.node_name:
        return BindOutcome(BindResult.TAKEN, problem, node=found.spec.node_name)
    if found.metadata.resource_version != wanted.metadata.resource_version:
        return BindOutcome(BindResult.CHANGED, problem)
    return BindOutcome(BindResult.FAILED, problem)
