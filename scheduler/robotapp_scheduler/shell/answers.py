"""The pages that are not for everybody: /metrics, /explain, /configz and /simulate.

Who asks is settled first, then what they may see; every refusal says what would help.
"""

from collections.abc import Callable, Mapping
from typing import Any, Final, Protocol

from aiohttp import web
from prometheus_client import CollectorRegistry
from prometheus_client.exposition import CONTENT_TYPE_LATEST, generate_latest

from robotapp_api.serving.access import Access, Caller
from robotapp_api.serving.pages import PathGate, as_json, asked, caller, problem, refused, unknown_caller
from robotapp_scheduler.shell.simulating import Simulator

A_ROLE_FOR_PODS: Final = "ClusterRole view may, ask for a RoleBinding of it there"


class Gate(PathGate, Protocol):
    """Says what a caller may see; see `access.Gatekeeper`."""

    async def access(self, caller: Caller, namespace: str) -> Access: ...


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
        refusal = await refused(self._gate, request, "get", "/metrics")
        if refusal:
            return refusal
        return web.Response(body=generate_latest(self._registry), headers={"Content-Type": CONTENT_TYPE_LATEST})

    async def _configz(self, request: web.Request) -> web.Response:
        refusal = await refused(self._gate, request, "get", "/configz")
        return refusal or as_json({"kubescheduler.config.k8s.io": self._config()})

    async def _explained(self, request: web.Request) -> web.Response:
        namespace, pod = request.match_info["namespace"], request.match_info["pod"]
        access = await asked(self._gate.access(caller(request), namespace))
        if not isinstance(access, Access):
            return access
        if access is Access.UNKNOWN_CALLER:
            return unknown_caller(request)
        if access is Access.FORBIDDEN:
            return problem(403, f"you may not get pods in namespace {namespace}: {A_ROLE_FOR_PODS}")
        full = request.query.get("full", "") in {"1", "true"}
        found = self._explain(namespace, pod, with_nodes=access is Access.ALL, full=full)
        if found is None:
            return problem(404, f"no decision is known for pod {namespace}/{pod}: it is not ours, or not seen yet")
        return as_json(found)

    async def _wanted(self, request: web.Request) -> web.Response:
        refusal = await refused(self._gate, request, "get", "/simulate")
        return refusal or as_json({"resources": self._simulator.wanted()})

    async def _simulated(self, request: web.Request) -> web.Response:
        refusal = await refused(self._gate, request, "post", "/simulate")
        if refusal:
            return refusal
        replay = request.query.get("replay", "0")
        if not replay.isdecimal() or len(replay) > 6:
            return problem(400, "replay must be a number of pods")
        found = await self._simulator.simulate(request.content.iter_chunked(1 << 16), replay=int(replay))
        return web.Response(status=found.status, body=found.body, content_type="application/json")
