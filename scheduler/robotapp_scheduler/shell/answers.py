"""The pages that are not for everybody: /metrics, /explain, /configz and /simulate.

Who asks is settled first, then what they may see; every refusal says what would help.
"""

from collections.abc import Awaitable, Callable, Mapping
from typing import Any, Final, Protocol

import msgspec
from aiohttp import web
from prometheus_client import CollectorRegistry
from prometheus_client.exposition import CONTENT_TYPE_LATEST, generate_latest

from robotapp_api.client.errors import ClientError
from robotapp_scheduler.shell.access import Access, Caller, certified
from robotapp_scheduler.shell.simulating import Simulator

WHO_ARE_YOU: Final = "send a bearer token of the cluster (Authorization: Bearer $(kubectl create token ...)) or a client certificate of it"


class Gate(Protocol):
    """Says what a caller may see; see `access.Gatekeeper`."""

    async def access(self, caller: Caller, namespace: str) -> Access: ...

    async def path(self, caller: Caller, verb: str, path: str) -> Access: ...


class Explain(Protocol):
    """The explanation of a pod, None when nothing is known about it. `full`: the table over all nodes, made now."""

    def __call__(self, namespace: str, name: str, *, with_nodes: bool, full: bool) -> Mapping[str, Any] | None: ...


class Everything:
    """The gate of a developer's own machine: everybody sees all."""

    async def access(self, _caller: Caller, _namespace: str) -> Access:
        return Access.ALL

    async def path(self, _caller: Caller, _verb: str, _path: str) -> Access:
        return Access.ALL


class Answers:
    """Metrics, explanations and the configuration in use."""

    def __init__(
        self,
        *,
        gate: Gate,
        registry: CollectorRegistry,
        explain: Explain,
        config: Callable[[], Mapping[str, Any]],
        simulator: Simulator,
    ) -> None:
        self._gate = gate
        self._registry = registry
        self._explain = explain
        self._config = config
        self._simulator = simulator

    def __repr__(self) -> str:
        return f"<Answers behind {self._gate!r}>"

    def add_to(self, router: web.UrlDispatcher) -> None:
        """Register the pages."""
        router.add_get("/metrics", self._metrics)
        router.add_get("/configz", self._configz)
        router.add_get("/explain/{namespace}/{pod}", self._explained)
        router.add_get("/simulate", self._wanted)
        router.add_post("/simulate", self._simulated)

    async def _metrics(self, request: web.Request) -> web.Response:
        refused = await self._refused(request, "get", "/metrics")
        if refused:
            return refused
        return web.Response(body=generate_latest(self._registry), headers={"Content-Type": CONTENT_TYPE_LATEST})

    async def _configz(self, request: web.Request) -> web.Response:
        refused = await self._refused(request, "get", "/configz")
        return refused or as_json({"kubescheduler.config.k8s.io": self._config()})

    async def _explained(self, request: web.Request) -> web.Response:
        namespace, pod = request.match_info["namespace"], request.match_info["pod"]
        access = await self._ask(self._gate.access(caller(request), namespace))
        if not isinstance(access, Access):
            return access
        if access is Access.UNKNOWN_CALLER:
            return problem(401, WHO_ARE_YOU)
        if access is Access.FORBIDDEN:
            return problem(403, f"you may not get pods in namespace {namespace}")
        full = request.query.get("full", "") in {"1", "true"}
        found = self._explain(namespace, pod, with_nodes=access is Access.ALL, full=full)
        if found is None:
            return problem(404, f"no decision is known for pod {namespace}/{pod}: it is not ours, or not seen yet")
        return as_json(found)

    async def _wanted(self, request: web.Request) -> web.Response:
        refused = await self._refused(request, "get", "/simulate")
        return refused or as_json({"resources": self._simulator.wanted()})

    async def _simulated(self, request: web.Request) -> web.Response:
        refused = await self._refused(request, "post", "/simulate")
        if refused:
            return refused
        replay = request.query.get("replay", "0")
        if not replay.isdecimal() or len(replay) > 6:
            return problem(400, "replay must be a number of pods")
        found = await self._simulator.simulate(request.content.iter_chunked(1 << 16), replay=int(replay))
        return web.Response(status=found.status, body=found.body, content_type="application/json")

    async def _refused(self, request: web.Request, verb: str, path: str) -> web.Response | None:
        """Why the caller may not use this path of ours; None when it may."""
        access = await self._ask(self._gate.path(caller(request), verb, path))
        if not isinstance(access, Access):
            return access
        if access is Access.UNKNOWN_CALLER:
            return problem(401, WHO_ARE_YOU)
        return None if access is Access.ALL else problem(403, f"you may not {verb} {path}")

    @staticmethod
    async def _ask(asked: Awaitable[Access]) -> Access | web.Response:
        try:
            return await asked
        except ClientError as error:
            return problem(503, f"the API server cannot say who you are: {error}")


def caller(request: web.Request) -> Caller:
    """What the request brings to be known by; a certificate wins over a token, as in the API server's own order."""
    certificate = request.transport.get_extra_info("peercert") if request.transport else None
    user = certified(certificate.get("subject")) if certificate else None
    if user is not None:
        return Caller(user=user)
    scheme, _, token = request.headers.get("Authorization", "").partition(" ")
    return Caller(token=token.strip() if scheme.lower() == "bearer" else "")


def as_json(value: Any, status: int = 200) -> web.Response:
    return web.Response(status=status, body=msgspec.json.encode(value), content_type="application/json")


def problem(status: int, text: str) -> web.Response:
    return as_json({"error": text}, status)
