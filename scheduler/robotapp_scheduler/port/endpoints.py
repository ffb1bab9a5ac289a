"""The pages of the port: health for everybody; /metrics, /explain, /configz, /simulate and /what-if for authorised users.

The caller is authenticated first, then what it may see and how often; every refusal names what would help.
"""

import time
from collections.abc import Awaitable, Callable
from typing import Final, Protocol

from aiohttp import web
from prometheus_client.exposition import CONTENT_TYPE_LATEST

from robotapp_api.values.quantities.buckets import Buckets
from robotapp_client.serving.access import Access, Caller, TooManyError
from robotapp_client.serving.pages import (
    PathGate,
    asked,
    caller,
    list_pages,
    problem,
    refused,
    too_many,
    unknown_caller,
)
from robotapp_scheduler.port.entrance import BodyError, Entrance, limit_pieces, refuse
from robotapp_scheduler.port.frames import NOT_RECORDED, Request, Response
from robotapp_scheduler.port.remote import Scheduler
from robotapp_scheduler.port.simulate import Simulator
from robotapp_scheduler.what_if.question import MOST_BODY, Question, QuestionError, parse

A_ROLE_FOR_PODS: Final = "ClusterRole view may, ask for a RoleBinding of it there"
EXPLAIN_PER_S, EXPLAIN_AT_ONCE = 10.0, 100
DECIDE_PER_S, DECIDE_AT_ONCE = 0.5, 30
SIMULATION_BODY_S: Final = 30.0
OFTEN: Final = "you ask for explanations too often; ask again later"
NAMES_NODES: Final = "nodeLoss and rtt name nodes: you may not get nodes; ClusterRole robotapp-cluster-viewer may, ask for a binding of it"


class Gate(PathGate, Protocol):
    """Decides what a caller may see, and names its user; see `access.Gatekeeper`."""

    async def access(self, caller: Caller, namespace: str) -> Access: ...
    def user_of(self, caller: Caller) -> str: ...


class AllowAll:
    """The gate of a developer's own machine: every caller sees all."""

    async def access(self, _caller: Caller, _namespace: str) -> Access:
        return Access.ALL

    async def path(self, _caller: Caller, _verb: str, _path: str) -> Access:
        return Access.ALL

    def user_of(self, caller: Caller) -> str:
        return caller.address


class Endpoints:
    """Metrics, explanations, the configuration in use, simulations."""

    def __init__(
        self,
        *,
        gate: Gate,
        scheduler: Scheduler,
        simulator: Simulator,
        entrance: Entrance | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._gate = gate
        self._scheduler = scheduler
        self._simulator = simulator
        self._explained_by = Buckets(per_s=EXPLAIN_PER_S, burst=EXPLAIN_AT_ONCE, clock=clock)
        self._decided_by = Buckets(per_s=DECIDE_PER_S, burst=DECIDE_AT_ONCE, clock=clock)
        self._entrance = entrance or Entrance()

    def __repr__(self) -> str:
        return f"<Endpoints behind {self._gate!r}>"

    def add_to(self, router: web.UrlDispatcher) -> None:
        """Register the pages."""
        router.add_get("/metrics", self._metrics)
        router.add_get("/configz", self._configz)
        router.add_get("/explain/{namespace}/{pod}", self._explained)
        router.add_get("/simulate", self._wanted)
        router.add_post("/simulate", self._simulated)
        router.add_post("/what-if", self._what_if)

    async def _metrics(self, request: web.Request) -> web.Response:
        refusal = await refused(self._gate, request, "get", "/metrics")
        if refusal:
            return refusal
        response = await self._scheduler.page("metrics")
        return web.Response(status=response.status, body=response.body, headers={"Content-Type": CONTENT_TYPE_LATEST})

    async def _configz(self, request: web.Request) -> web.Response:
        return await refused(self._gate, request, "get", "/configz") or _json(await self._scheduler.page("configz"))

    async def _explained(self, request: web.Request) -> web.Response:
        namespace, pod = request.match_info["namespace"], request.match_info["pod"]
        access = await asked(self._gate.access(caller(request), namespace))
        if not isinstance(access, Access):
            return access
        if access is Access.UNKNOWN_CALLER:
            return unknown_caller(request)
        if access is Access.FORBIDDEN:
            return problem(403, f"you may not get pods in namespace {namespace}: {A_ROLE_FOR_PODS}")
        try:
            response = await self._explanation(request, with_nodes=access is Access.ALL)
        except TooManyError as error:
            return too_many(error)
        if response.status == 404:
            return problem(404, f"no decision is known for pod {namespace}/{pod}: it is not ours, or not seen yet")
        return _json(response)

    async def _explanation(self, request: web.Request, *, with_nodes: bool) -> Response:
        """Raises TooManyError. What is not recorded is decided once more, which each user may request now and then."""
        user = self._gate.user_of(caller(request))
        self._count(self._explained_by, user)
        namespace, pod = request.match_info["namespace"], request.match_info["pod"]
        full = request.query.get("full", "") in {"1", "true"}
        response = Response(0, NOT_RECORDED, b"")
        if not full:
            response = await self._scheduler.request(
                Request("explain", namespace=namespace, pod=pod, with_nodes=with_nodes)
            )
        if response.status == NOT_RECORDED:
            self._count(self._decided_by, user)
            response = await self._scheduler.request(
                Request("decide", namespace=namespace, pod=pod, with_nodes=with_nodes, full=full)
            )
        return response

    @staticmethod
    def _count(buckets: Buckets, user: str) -> None:
        if wait_s := buckets.wait_s(user):
            raise TooManyError(OFTEN, wait_s)

    async def _wanted(self, request: web.Request) -> web.Response:
        return await refused(self._gate, request, "get", "/simulate") or _json(await self._scheduler.page("kinds"))

    async def _simulated(self, request: web.Request) -> web.Response:
        refusal = await refused(self._gate, request, "post", "/simulate")
        if refusal:
            return refusal
        replay = request.query.get("replay", "0")
        if not replay.isdecimal() or len(replay) > 6:
            return problem(400, "replay must be a number of pods")
        user = self._gate.user_of(caller(request))
        try:
            with self._entrance.take_turn(user):
                pieces = limit_pieces(request.content, SIMULATION_BODY_S)
                status, body = await self._simulator.simulate(pieces, replay=int(replay))
        except (TooManyError, BodyError) as error:
            return refuse(error)
        await self._scheduler.request(Request("simulated", status=status))
        return web.Response(status=status, body=body, content_type="application/json")

    async def _what_if(self, request: web.Request) -> web.Response:
        """What would be different. Users who may get all pods see all of it, others the part of `?namespace=`."""
        access, namespace = await self._access(request)
        if not isinstance(access, Access):
            return access
        if access is Access.UNKNOWN_CALLER:
            return unknown_caller(request)
        if access is Access.FORBIDDEN:
            where = f"in namespace {namespace}" if namespace else "in all namespaces; name one: ?namespace="
            return problem(403, f"you may not get pods {where}: {A_ROLE_FOR_PODS}")
        user = self._gate.user_of(caller(request))
        try:
            self._count(self._decided_by, user)
            async with self._entrance.admit(user, request, most=MOST_BODY) as body:
                # Decoded it takes many times as much memory: it must not be held while its answer is awaited.
                return await self._beyond_rights(request, parse(body), access, namespace) or _json(
                    await self._scheduler.request(
                        Request("what-if", namespace=namespace, with_nodes=access is Access.ALL, body=body)
                    )
                )
        except QuestionError as error:
            return problem(400, str(error))
        except (TooManyError, BodyError) as error:
            return refuse(error)

    async def _access(self, request: web.Request) -> tuple[Access | web.Response, str]:
        """What the caller may see, or why that is not known, and the namespace it holds for ("" for all)."""
        namespace = request.query.get("namespace", "")
        access = await asked(self._gate.access(caller(request), ""))
        if access is not Access.FORBIDDEN:
            return access, ""
        if namespace:
            access = await asked(self._gate.access(caller(request), namespace))
        return access, namespace

    async def _beyond_rights(
        self, request: web.Request, question: Question, access: Access, namespace: str
    ) -> web.Response | None:
        """The refusal of a question beyond the user's rights."""
        if question.nodes and access is not Access.ALL:
            return problem(403, NAMES_NODES)
        for own, name in question.names:
            if namespace not in ("", own):
                return problem(403, f"RobotApp {own}/{name}: you may get pods in namespace {namespace} only")
        if question.config is not None:
            return await refused(self._gate, request, "post", "/simulate")
        return None


def application(scheduler: Scheduler, endpoints: Endpoints) -> web.Application:
    """The aiohttp application."""

    def health(what: str) -> Callable[[web.Request], Awaitable[web.StreamResponse]]:
        async def response(_: web.Request) -> web.StreamResponse:
            found = await scheduler.page(what)
            return web.Response(status=found.status, body=found.body, content_type="text/plain")

        return response

    app = web.Application()
    app.router.add_get("/livez", health("livez"))
    app.router.add_get("/healthz", health("livez"))
    app.router.add_get("/readyz", health("readyz"))
    endpoints.add_to(app.router)
    list_pages(app)
    return app


def _json(response: Response) -> web.Response:
    return web.Response(status=response.status, body=response.body, content_type="application/json")
