"""Pages that need rights: first the caller is authenticated, then authorised; every refusal names what would help."""

import math
from collections.abc import Awaitable
from typing import Any, Final, Protocol

import msgspec
from aiohttp import web

from robotapp_client.serving.access import Access, Caller, TooManyError, certified
from robotapp_client.serving.server import read_network
from robotapp_client.transport.errors import ClientError

WHO_ARE_YOU: Final = "send a bearer token of the cluster (Authorization: Bearer $(kubectl create token ...)) or a client certificate of it"
A_ROLE_THAT_MAY: Final = (
    "ClusterRole robotapp-cluster-viewer may (robotapp-metrics-reader: /metrics alone), ask for a binding of it"
)


class PathGate(Protocol):
    """Decides whether a caller may use a path that belongs to no namespace; see `access.Gatekeeper`."""

    async def path(self, caller: Caller, verb: str, path: str) -> Access: ...


async def refused(gate: PathGate, request: web.Request, verb: str, path: str) -> web.Response | None:
    """The response to a caller who may not use this path; None for one who may."""
    access = await asked(gate.path(caller(request), verb, path))
    if not isinstance(access, Access):
        return access
    if access is Access.UNKNOWN_CALLER:
        return unknown_caller(request)
    return None if access is Access.ALL else problem(403, f"you may not {verb} {path}: {A_ROLE_THAT_MAY}")


def unknown_caller(request: web.Request) -> web.Response:
    """The response to a caller without credentials, or with a token that is not valid."""
    stale = "the token is none of this cluster, or has expired; " if caller(request).token else ""
    return problem(401, stale + WHO_ARE_YOU)


def list_pages(app: web.Application) -> None:
    """Makes the 404 of unknown paths list the paths that are served. Call it after all others were added."""
    pages = ", ".join(sorted({resource.canonical for resource in app.router.resources()}))

    async def nothing_here(request: web.Request) -> web.Response:
        return problem(404, f"nothing is served at {request.method} {request.path}; there are {pages}")

    app.router.add_route("*", "/{path:.*}", nothing_here)


async def asked(answer: Awaitable[Access]) -> Access | web.Response:
    """The gate's decision, or a response when it cannot decide (the API server is away, too many requests)."""
    try:
        return await answer
    except ClientError as error:
        return problem(503, f"the API server cannot say who you are: {error}")
    except TooManyError as error:
        return too_many(error)


def caller(request: web.Request) -> Caller:
    """What the request brings to be known by; a certificate wins over a token, as in the API server's own order."""
    certificate = request.transport.get_extra_info("peercert") if request.transport else None
    user = certified(certificate.get("subject")) if certificate else None
    if user is not None:
        return Caller(user=user, address=find_network(request))
    scheme, _, token = request.headers.get("Authorization", "").partition(" ")
    is_token = scheme.lower() == "bearer" and token.isascii()  # else the API server would be sent what is no text
    return Caller(token=token.strip() if is_token else "", address=find_network(request))


def find_network(request: web.Request) -> str:
    """Returns what counts as one address of the peer, as for its connections: a host with IPv6 has many to ask from."""
    peer = request.remote or ""
    try:
        return read_network(peer)
    except ValueError:  # it came by a socket of this machine
        return peer


def as_json(value: Any, status: int = 200) -> web.Response:
    return web.Response(status=status, body=msgspec.json.encode(value), content_type="application/json")


def too_many(error: TooManyError) -> web.Response:
    """With the header that well-behaved clients wait by."""
    answer = problem(429, str(error))
    answer.headers["Retry-After"] = str(math.ceil(error.retry_s))
    return answer


def problem(status: int, text: str) -> web.Response:
    return as_json({"error": text}, status)
