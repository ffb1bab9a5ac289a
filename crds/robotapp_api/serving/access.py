"""Who asks our port, and what they may see: the API server decides both.

A caller is known by a bearer token (TokenReview) or by a client certificate that the TLS layer has checked against the
API server's own authority; then the common name is the user and the organisations are the groups, as everywhere in
Kubernetes. An explanation shows pods and node names, so it takes the right to get pods in that namespace; node names are
shown only to those who may get nodes (SubjectAccessReview). Answers are remembered for a few seconds.
"""

import time
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from robotapp_api.client.api import ApiClient
from robotapp_api.client.resources import Resource

TOKEN_REVIEWS = Resource("authentication.k8s.io", "v1", "tokenreviews", "TokenReview", namespaced=False)
ACCESS_REVIEWS = Resource("authorization.k8s.io", "v1", "subjectaccessreviews", "SubjectAccessReview", namespaced=False)
REMEMBER_S = 10.0
CACHE_LIMIT = 1000
AUTHENTICATED = "system:authenticated"


class Access(StrEnum):
    """What a caller may see."""

    ALL = "All"
    WITHOUT_NODES = "WithoutNodes"
    FORBIDDEN = "Forbidden"
    UNKNOWN_CALLER = "UnknownCaller"


@dataclass(frozen=True, slots=True)
class User:
    """A user as the API server names one."""

    name: str
    groups: tuple[str, ...] = ()
    uid: str = ""
    extra: Mapping[str, list[str]] = field(default_factory=dict, compare=False)


@dataclass(frozen=True, slots=True)
class Caller:
    """What a request brings: a token, or the subject of a certificate the TLS layer accepted."""

    token: str = ""
    user: User | None = None


@dataclass(frozen=True, slots=True)
class _Answer:
    access: Access
    until_s: float


class Gatekeeper:
    """Decides per (caller, question). Raises `ClientError` when the API server cannot be asked."""

    def __init__(self, client: ApiClient, *, clock: Callable[[], float] = time.monotonic) -> None:
        self._client = client
        self._clock = clock
        self._answers: dict[tuple[Caller, tuple[str, ...]], _Answer] = {}

    def __repr__(self) -> str:
        return f"<Gatekeeper {len(self._answers)} answers remembered>"

    async def access(self, caller: Caller, namespace: str) -> Access:
        """What this caller may see of the pods of a namespace."""

        async def ask(user: User) -> Access:
            if not await self._may(user, resource={"verb": "get", "resource": "pods", "namespace": namespace}):
                return Access.FORBIDDEN
            return (
                Access.ALL
                if await self._may(user, resource={"verb": "get", "resource": "nodes"})
                else Access.WITHOUT_NODES
            )

        return await self._remembered(caller, ("pods", namespace), ask)

    async def path(self, caller: Caller, verb: str, path: str) -> Access:
        """Whether this caller may use a path of ours that belongs to no namespace: ALL or a refusal."""

        async def ask(user: User) -> Access:
            return Access.ALL if await self._may(user, path={"verb": verb, "path": path}) else Access.FORBIDDEN

        return await self._remembered(caller, ("path", verb, path), ask)

    async def _remembered(
        self, caller: Caller, question: tuple[str, ...], ask: Callable[[User], Awaitable[Access]]
    ) -> Access:
        known = self._answers.get((caller, question))
        if known and known.until_s > self._clock():
            return known.access
        user = caller.user or await self._user_of(caller.token)
        access = Access.UNKNOWN_CALLER if user is None else await ask(user)
        if len(self._answers) >= CACHE_LIMIT:
            self._answers.clear()
        self._answers[caller, question] = _Answer(access, self._clock() + REMEMBER_S)
        return access

    async def _user_of(self, token: str) -> User | None:
        if not token:
            return None
        review = await self._client.create(TOKEN_REVIEWS, {"spec": {"token": token}})
        status = review.get("status") or {}
        if not status.get("authenticated"):
            return None
        user = status.get("user") or {}
        return User(
            name=user.get("username", ""),
            groups=tuple(user.get("groups") or ()),
            uid=user.get("uid", ""),
            extra=user.get("extra") or {},
        )

    async def _may(
        self, user: User, *, resource: Mapping[str, str] | None = None, path: Mapping[str, str] | None = None
    ) -> bool:
        spec = {"user": user.name, "uid": user.uid, "groups": list(user.groups), "extra": dict(user.extra)}
        asked = {"resourceAttributes": dict(resource)} if resource else {"nonResourceAttributes": dict(path or {})}
        review = await self._client.create(ACCESS_REVIEWS, {"spec": spec | asked})
        return bool((review.get("status") or {}).get("allowed"))


def certified(subject: object) -> User | None:
    """The user a checked certificate stands for (`ssl.SSLSocket.getpeercert()["subject"]`); None without a common name."""
    if not isinstance(subject, tuple):
        return None
    pairs = [pair for relative in subject for pair in relative]
    names = [value for key, value in pairs if key == "commonName"]
    if not names:
        return None
    groups = tuple(value for key, value in pairs if key == "organizationName")
    return User(name=names[0], groups=(*groups, AUTHENTICATED))
