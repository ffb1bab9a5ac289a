"""Who may read an explanation: the API server says who a token is (TokenReview) and what they may see.

An explanation shows pods and node names, so it takes the right to get pods in that namespace; node names are shown
only to those who may get nodes. Answers are remembered for a few seconds.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from robotapp_api.client.api import ApiClient
from robotapp_api.client.resources import Resource

TOKEN_REVIEWS = Resource("authentication.k8s.io", "v1", "tokenreviews", "TokenReview", namespaced=False)
ACCESS_REVIEWS = Resource("authorization.k8s.io", "v1", "subjectaccessreviews", "SubjectAccessReview", namespaced=False)
REMEMBER_S = 10.0
CACHE_LIMIT = 1000


class Access(StrEnum):
    """What a caller may see."""

    ALL = "All"
    WITHOUT_NODES = "WithoutNodes"
    FORBIDDEN = "Forbidden"
    UNKNOWN_CALLER = "UnknownCaller"


@dataclass(frozen=True, slots=True)
class _Answer:
    access: Access
    until_s: float


class Gatekeeper:
    """Decides per (token, namespace). Raises `ClientError` when the API server cannot be asked."""

    def __init__(self, client: ApiClient, *, clock: Callable[[], float] = time.monotonic) -> None:
        self._client = client
        self._clock = clock
        self._answers: dict[tuple[str, str], _Answer] = {}

    def __repr__(self) -> str:
        return f"<Gatekeeper {len(self._answers)} answers remembered>"

    async def access(self, token: str, namespace: str) -> Access:
        if not token:
            return Access.UNKNOWN_CALLER
        known = self._answers.get((token, namespace))
        if known and known.until_s > self._clock():
            return known.access
        access = await self._ask(token, namespace)
        if len(self._answers) >= CACHE_LIMIT:
            self._answers.clear()
        self._answers[token, namespace] = _Answer(access, self._clock() + REMEMBER_S)
        return access

    async def _ask(self, token: str, namespace: str) -> Access:
        review = await self._client.create(TOKEN_REVIEWS, {"spec": {"token": token}})
        status = review.get("status") or {}
        if not status.get("authenticated"):
            return Access.UNKNOWN_CALLER
        user = status.get("user") or {}
        if not await self._allowed(user, {"verb": "get", "resource": "pods", "namespace": namespace}):
            return Access.FORBIDDEN
        if not await self._allowed(user, {"verb": "get", "resource": "nodes"}):
            return Access.WITHOUT_NODES
        return Access.ALL

    async def _allowed(self, user: dict[str, Any], attributes: dict[str, str]) -> bool:
        spec = {
            "user": user.get("username", ""),
            "uid": user.get("uid", ""),
            "groups": user.get("groups") or [],
            "extra": user.get("extra") or {},
            "resourceAttributes": attributes,
        }
        review = await self._client.create(ACCESS_REVIEWS, {"spec": spec})
        return bool((review.get("status") or {}).get("allowed"))
