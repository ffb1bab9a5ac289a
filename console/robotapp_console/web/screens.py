"""The screens: what each reads, and what its templates get."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Protocol

from aiohttp import web

from robotapp_api.values.naming import DNS_LABEL
from robotapp_client import ClientError, Unauthorized
from robotapp_console.cluster.informer_set import InformerSet
from robotapp_console.cluster.kinds import APP_KINDS, FLEET_KINDS, NODES_KINDS, Kind
from robotapp_console.views.app.page import EventRow, build_app, build_events, suggest_apps
from robotapp_console.views.app.timeline import build_timeline
from robotapp_console.views.fleet import STATES, build_fleet, draw_links, read_fleet_query, take_fleet_page
from robotapp_console.views.links import read_zones
from robotapp_console.views.nodes import build_nodes, read_nodes_query, take_nodes_page
from robotapp_console.views.paging import FAR, NEAR, Query
from robotapp_console.views.pairs import ZonePairs, build_pairs
from robotapp_console.views.snapshot import Snapshot
from robotapp_console.views.texts import clean
from robotapp_console.web.app_actions import SHUT_DOWN, find_allowed
from robotapp_console.web.sessions import Caller

EXPIRED: Final = "The API server does not accept your credentials any more. Load the page again."


@dataclass(frozen=True, slots=True)
class ScreenContent:
    """A screen at one moment. `fingerprint` differs as soon as anything on it does, apart from the passing of time."""

    title: str
    context: Mapping[str, Any]
    fingerprint: object
    snapshot: Snapshot
    missing: str = ""
    """Why there is nothing to show."""


class Screen(Protocol):
    """One screen; `name` is the beginning of its templates' names and `path` its place in the navigation."""

    @property
    def name(self) -> str: ...
    @property
    def path(self) -> str: ...
    @property
    def kinds(self) -> tuple[Kind, ...]: ...
    def namespace(self, request: web.Request) -> str: ...
    def key(self, request: web.Request) -> tuple[str, ...]: ...
    async def show(self, request: web.Request, caller: Caller, informers: InformerSet) -> ScreenContent: ...


def read_namespace(text: str) -> str:
    """Returns the namespace, empty for all. Raises HTTPBadRequest for what no namespace can be called."""
    text = text.strip()
    if text and not DNS_LABEL.fullmatch(text):
        raise web.HTTPBadRequest(text="No namespace can have that name: small letters, digits and dashes, 63 at most.")
    return text


class FleetScreen:
    name: Final = "fleet"
    path: Final = "/"
    kinds: Final = FLEET_KINDS

    def namespace(self, request: web.Request) -> str:
        return read_namespace(request.query.get("namespace", ""))

    def key(self, request: web.Request) -> tuple[str, ...]:
        del request
        return ("fleet",)

    async def show(self, request: web.Request, caller: Caller, informers: InformerSet) -> ScreenContent:
        namespace = self.namespace(request)
        await _wait_for_first_build(informers, self.key(request), namespace, caller.home)
        snapshot, fleet = informers.build_model(self.key(request), build_fleet, namespace=namespace, home=caller.home)
        query = read_fleet_query(request.query)
        page = take_fleet_page(fleet, query)
        links = draw_links(page, snapshot)
        context = {
            "fleet": fleet,
            "page": page,
            "links": links,
            "query": query,
            "zones": fleet.zones,
            "states": STATES,
            "namespace": snapshot.namespace,
            "stale": snapshot.stale,
        }
        fingerprint = (page, fleet.problems, fleet.loose, fleet.counts, fleet.refusals, snapshot.stale, links)
        return ScreenContent("Fleet", context, fingerprint, snapshot)


class NodesScreen:
    name: Final = "nodes"
    path: Final = "/nodes"
    kinds: Final = NODES_KINDS

    def namespace(self, request: web.Request) -> str:
        return read_namespace(request.query.get("namespace", ""))

    def key(self, request: web.Request) -> tuple[str, ...]:
        del request
        return ("nodes",)

    async def show(self, request: web.Request, caller: Caller, informers: InformerSet) -> ScreenContent:
        snapshot, nodes = informers.build_model(self.key(request), build_nodes, namespace="", home=caller.home)
        query = read_nodes_query(request.query)
        page = take_nodes_page(nodes, query)
        pairs = await self._find_pairs(query, caller, informers)
        may_shut_down = await informers.rights.is_surely_granted(SHUT_DOWN)
        context = {
            "nodes": nodes,
            "page": page,
            "query": query,
            "zones": nodes.zones,
            "tiers": nodes.tiers,
            "pairs": pairs,
            "may_shut_down": may_shut_down,
            "namespace": self.namespace(request),
            "stale": snapshot.stale,
        }
        fingerprint = (page, nodes.matrix, nodes.refusals, snapshot.stale, pairs, may_shut_down)
        return ScreenContent("Nodes", context, fingerprint, snapshot)

    async def _find_pairs(self, query: Query, caller: Caller, informers: InformerSet) -> ZonePairs | None:
        """Returns the pairs of nodes of the cell that was chosen in the matrix."""
        near, far = query.filter_value(NEAR), query.filter_value(FAR)
        if not (near and far):
            return None
        key = ("nodes", "pairs", near, far)
        await _wait_for_first_build(informers, key, "", caller.home)
        _, pairs = informers.build_model(
            key,
            lambda snapshot: build_pairs(snapshot, read_zones(snapshot.nodes), near, far),
            namespace="",
            home=caller.home,
        )
        return pairs


class AppScreen:
    name: Final = "app"
    path: Final = "/apps"
    kinds: Final = APP_KINDS

    def namespace(self, request: web.Request) -> str:
        return read_namespace(request.match_info["namespace"])

    def key(self, request: web.Request) -> tuple[str, ...]:
        names = (request.match_info["namespace"], request.match_info["name"], request.query.get("robot", ""))
        return ("app", *names)

    async def show(self, request: web.Request, caller: Caller, informers: InformerSet) -> ScreenContent:
        namespace = self.namespace(request)
        _, _, name, robot = self.key(request)
        await _wait_for_first_build(informers, self.key(request), namespace, caller.home)
        snapshot, app = informers.build_model(
            self.key(request),
            lambda snapshot: build_app(snapshot, namespace, name, robot),
            namespace=namespace,
            home=caller.home,
        )
        title = clean(f"{namespace}/{name}", 320)
        if app is None:
            refusals = snapshot.list_refusals("robotapps")
            missing = f"{refusals[0].cure} {refusals[0].why}" if refusals else f"There is no RobotApp {title}."
            links = {"links": suggest_apps(snapshot)}
            return ScreenContent(title, links, missing, snapshot, missing)
        stored = snapshot.apps[f"{namespace}/{name}"]
        try:
            events, refusal, are_events_whole = await _read_events(informers, namespace, stored.metadata.uid)
        except Unauthorized:
            return ScreenContent(title, {"links": {}}, EXPIRED, snapshot, EXPIRED)
        actions = await find_allowed(informers, namespace, name)
        timeline = build_timeline(app.instances, events)
        context: dict[str, Any] = {
            "app": app,
            "timeline": timeline,
            "allowed": actions,
            "events": events,
            "events_refusal": refusal,
            "are_events_whole": are_events_whole,
            "stale": snapshot.stale,
        }
        on_robot = f" on {clean(robot, 63)}" if robot else ""
        return ScreenContent(
            title + on_robot, context, (app, actions, timeline, events, refusal, snapshot.stale), snapshot
        )


async def _wait_for_first_build(informers: InformerSet, key: tuple[str, ...], namespace: str, home: str) -> None:
    """Waits until the model may be built. Raises HTTPTooManyRequests for a user who opens many addresses at once."""
    if not await informers.wait_for_first_build(key, namespace=namespace, home=home):
        raise web.HTTPTooManyRequests


async def _read_events(informers: InformerSet, namespace: str, uid: str) -> tuple[tuple[EventRow, ...], str, bool]:
    """Returns the rows, or none and why they cannot be shown, and whether all events were read. Raises Unauthorized."""
    try:
        answer = await informers.list_events(namespace, uid)
    except Unauthorized:
        raise
    except ClientError as error:
        return (), clean(str(error)), True
    return build_events(answer.events), "", answer.is_whole
