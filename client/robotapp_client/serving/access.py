"""Authenticates and authorises callers of a process' port; the API server decides both.

A caller is known by a bearer token (TokenReview) or by a client certificate that the TLS layer has checked against the
API server's own authority; then the common name is the user and the organisations are the groups, as everywhere in
Kubernetes. An explanation shows pods and node names, so it takes the right to get pods in that namespace; node names are
shown only to users who may get nodes (SubjectAccessReview). Decisions are kept for a few seconds.

Every request to the port may cause requests to the API server, so their rate is limited: for strangers per address and in
total, for callers that the API server has confirmed per user, whatever strangers do. Use a client with few connections of its own.
"""

import hashlib
import time
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Generic, TypeVar

from robotapp_api.values.quantities.buckets import Buckets
from robotapp_client.api.client import ApiClient
from robotapp_client.api.resources import Resource

TOKEN_REVIEWS = Resource("authentication.k8s.io", "v1", "tokenreviews", "TokenReview", namespaced=False)
ACCESS_REVIEWS = Resource("authorization.k8s.io", "v1", "subjectaccessreviews", "SubjectAccessReview", namespaced=False)
REMEMBER_S = 10.0
CACHE_LIMIT = 1000
TRUSTED_S = 600.0
"""How long a caller counts as confirmed, not as a stranger."""
STRANGERS_PER_S, STRANGERS_AT_ONCE = 20.0, 40
ADDRESS_PER_S, ADDRESS_AT_ONCE = 5.0, 20
CALLER_PER_S, CALLER_AT_ONCE = 10.0, 40
AUTHENTICATED = "system:authenticated"
_K = TypeVar("_K")
_V = TypeVar("_V")


class TooManyError(Exception):
    """The caller sent too many requests; it may try again after `retry_s`."""

    def __init__(self, text: str, retry_s: float) -> None:
        super().__init__(text)
        self.retry_s = retry_s


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
    """The credentials of a request: a token, or the subject of a certificate that the TLS layer accepted."""

    token: str = ""
    user: User | None = None
    address: str = field(default="", compare=False)
    """Its network address."""

    @property
    def key(self) -> str:
        """A key of the identity. Tokens are hashed, so that none is kept."""
        if self.user is not None:
            return f"user {(self.user.name, self.user.groups)!r}"  # joined, a name with a blank could be another's name and group
        return hashlib.sha256(self.token.encode(errors="surrogateescape")).hexdigest()


@dataclass(frozen=True, slots=True)
class _Answer:
    access: Access
    until_s: float


class _Kept(dict[_K, _V], Generic[_K, _V]):
    """A bounded dictionary that drops its oldest entry, so that many new keys do not empty it at once."""

    def keep(self, key: _K, value: _V) -> None:
        self.pop(key, None)
        if len(self) >= CACHE_LIMIT:
            del self[next(iter(self))]
        self[key] = value


class Gatekeeper:
    """Decides per (caller, question). Raises `ClientError` when the API server cannot be reached, `TooManyError` when the
    caller sends too many requests.
    """

    def __init__(self, client: ApiClient, *, clock: Callable[[], float] = time.monotonic) -> None:
        self._client = client
        self._clock = clock
        self._answers: _Kept[tuple[str, tuple[str, ...]], _Answer] = _Kept()
        self._unknown: _Kept[str, float] = _Kept()
        """Tokens that are not valid, and until when they are not reviewed again."""
        self._trusted: _Kept[str, tuple[str, float]] = _Kept()
        """Confirmed callers: the user, and until when they count as confirmed."""
        self._all = Buckets(per_s=STRANGERS_PER_S, burst=STRANGERS_AT_ONCE, clock=clock)
        self._addresses = Buckets(per_s=ADDRESS_PER_S, burst=ADDRESS_AT_ONCE, clock=clock)
        self._callers = Buckets(per_s=CALLER_PER_S, burst=CALLER_AT_ONCE, clock=clock)

    def __repr__(self) -> str:
        return f"<Gatekeeper {len(self._answers)} answers remembered>"

    def user_of(self, caller: Caller) -> str:
        """The user that was confirmed last for this caller, whichever of its tokens it brings."""
        return self._trusted.get(caller.key, ("", 0.0))[0]

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
        now_s, key = self._clock(), caller.key
        known = self._answers.get((key, question))
        if known and known.until_s > now_s:
            return known.access
        if self._unknown.get(key, now_s) > now_s or not (caller.token or caller.user):
            return Access.UNKNOWN_CALLER
        self._take_turn(caller, now_s)
        user = caller.user or await self._user_of(caller.token)
        if user is None:
            self._trusted.pop(key, None)
            self._unknown.keep(key, now_s + REMEMBER_S)
            return Access.UNKNOWN_CALLER
        self._trusted.keep(key, (user.name, now_s + TRUSTED_S))
        access = await ask(user)
        self._answers.keep((key, question), _Answer(access, self._clock() + REMEMBER_S))
        return access

    def _take_turn(self, caller: Caller, now_s: float) -> None:
        """Raises TooManyError. A caller with a certificate is no stranger, because the TLS layer has checked it."""
        name, until_s = self._trusted.get(caller.key, ("", 0.0))
        if caller.user is not None or until_s > now_s:
            wait_s = self._callers.wait_s(caller.user.name if caller.user else name)
        else:
            wait_s = self._addresses.wait_s(caller.address) or self._all.wait_s("")
        if wait_s:
            raise TooManyError("too many questions about who may see what; ask again later", wait_s)

    async def _user_of(self, token: str) -> User | None:
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
