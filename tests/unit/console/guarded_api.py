"""The fake API server with tokens and rights, and a console in front of it."""

import re
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from http.cookies import SimpleCookie
from typing import Any
from urllib.parse import parse_qsl, unquote, urlsplit

import msgspec
from aiohttp import ClientResponse, ClientSession, DummyCookieJar
from tests.support.apiserver import FakeApiServer, Key, Refused, verbs
from tests.support.apiserver.wire import TypedConnection
from tests.unit.console.objects import Object

from robotapp_client import Endpoint
from robotapp_client.serving.port import Limits, listen
from robotapp_console.cluster.informer_sets import InformerSets
from robotapp_console.web.console import Console
from robotapp_console.web.server import LIMITS, serve
from robotapp_console.web.sessions import LocalDoor, Seal

ADMIN, TENANT, VIEWER = "admin-token-0123456789", "tenant-token-0123456789", "viewer-token-0123456789"


class GuardedApi(FakeApiServer):
    """Knows three tokens: ADMIN may do everything, TENANT everything in namespace team-a, VIEWER read there. Counts watches by token."""

    def __init__(self) -> None:
        super().__init__()
        self.tokens = {ADMIN: "admin", TENANT: "tenant", VIEWER: "viewer"}
        self.forbidden: set[str] = set()
        """Plurals that not even ADMIN may read."""
        self.absent_groups: set[str] = set()
        """Groups without a kind in this cluster."""
        self.watches: list[tuple[str, str]] = []

    def answer(self, client: TypedConnection, method: str, url: str, body: bytes) -> None:
        address = urlsplit(url)
        token = client.authorization.removeprefix("Bearer ")
        if token not in self.tokens:
            self._refuse(client, Refused(401, "Unauthorized", "Unauthorized"))
            return
        where = verbs.target(unquote(address.path))
        if where.plural == "selfsubjectreviews":
            review = {"status": {"userInfo": {"username": self.tokens[token]}}}
            client.reply(201, msgspec.json.encode(review))
            return
        if where.plural == "selfsubjectaccessreviews":
            asked = msgspec.json.decode(body)["spec"]["resourceAttributes"]
            is_allowed = self._allows(token, asked["verb"], asked["resource"], asked.get("namespace"))
            client.reply(201, msgspec.json.encode({"status": {"allowed": is_allowed}}))
            return
        verb = "list" if method == "GET" else method.lower()
        if not self._allows(token, verb, where.plural, where.namespace):
            scope = f'in the namespace "{where.namespace}"' if where.namespace else "at the cluster scope"
            text = f'User "{self.tokens[token]}" cannot {verb} resource "{where.plural}" {scope}'
            self._refuse(client, Refused(403, "Forbidden", text))
            return
        if where.group in self.absent_groups:
            self._refuse(client, Refused(404, "NotFound", "the server could not find the requested resource"))
            return
        if dict(parse_qsl(address.query)).get("watch"):
            self.watches.append((self.tokens[token], where.plural))
        super().answer(client, method, url, body)

    def _allows(self, token: str, verb: str, plural: str, namespace: str | None) -> bool:
        if plural in self.forbidden:
            return False
        return token == ADMIN or (namespace == "team-a" and (token == TENANT or verb == "list"))

    def _refuse(self, client: TypedConnection, refusal: Refused) -> None:
        client.reply(refusal.code, msgspec.json.encode(refusal.status()))

    def put(self, collection: str, obj: Object) -> Object:
        """Stores an object with its status, in place of one of its name."""
        meta = obj["metadata"]
        key = Key(collection, meta.get("namespace", ""), meta["name"])
        if key in self.store.objects:
            body = obj | {"metadata": self.store.get(key)["metadata"] | meta}
            return self.store.overwrite(key, body)
        return self.store.create(key, obj)

    def remove(self, collection: str, name: str, namespace: str = "") -> None:
        self.store.delete(Key(collection, namespace, name), {})


ROBOTICS = "robotics.io/{}".format
APPS, INSTANCES, CLAIMS = map(ROBOTICS, ("robotapps", "robotappinstances", "robotclaims"))
POOLS, TELEMETRY = map(ROBOTICS, ("domainpools", "nodetelemetries"))
NODES, PODS, EVENTS = "/nodes", "/pods", "events.k8s.io/events"


@dataclass
class Browser:
    """A browser as far as these tests need one: cookies, Accept and Origin."""

    http: ClientSession
    base: str
    cookies: dict[str, str] = field(default_factory=dict)

    async def get(self, path: str, **headers: str) -> "Page":
        return await self._ask("GET", path, {"Accept": "text/html"} | headers)

    async def post(self, path: str, fields: dict[str, str], **headers: str) -> "Page":
        sent = {"Accept": "text/html", "Origin": self.base} | {
            key.replace("_", "-"): value for key, value in headers.items()
        }
        return await self._ask("POST", path, sent, fields)

    async def sign_in(self, token: str, *, home: str = "", to: str = "/") -> "Page":
        form = await self.get("/login")
        fields = {"token": token, "home": home, "next": to, "csrf": form.field("csrf")}
        return await self.post("/login", fields)

    @property
    def cookie_header(self) -> str:
        return "; ".join(f"{name}={value}" for name, value in self.cookies.items())

    async def _ask(
        self, method: str, path: str, headers: dict[str, str], fields: dict[str, str] | None = None
    ) -> "Page":
        headers = {key: value for key, value in (headers | {"Cookie": self.cookie_header}).items() if value}
        async with self.http.request(
            method, self.base + path, headers=headers, data=fields, allow_redirects=False
        ) as answer:
            page = Page(answer.status, answer.headers, await answer.text())
            self._keep_cookies(answer)
            return page

    def _keep_cookies(self, answer: ClientResponse) -> None:
        for line in answer.headers.getall("Set-Cookie", []):
            for name, morsel in SimpleCookie(line).items():
                if morsel.value:
                    self.cookies[name] = morsel.value
                else:
                    self.cookies.pop(name, None)


@dataclass
class Page:
    status: int
    headers: Any
    text: str

    def field(self, name: str) -> str:
        found = re.search(rf'name="{name}" value="([^"]*)"', self.text)
        assert found, f"no field {name} on the page"
        return found[1]


@dataclass
class Stage:
    """A running console, its API server, and browsers."""

    api: GuardedApi
    console: Console
    http: ClientSession
    base: str

    def browser(self) -> Browser:
        return Browser(self.http, self.base)


@asynccontextmanager
async def staged(
    *, local: bool = False, idle_s: float = 60.0, limits: Limits = LIMITS, **settings: Any
) -> AsyncIterator[Stage]:
    """A console on a free port. In the cluster's mode unless `local`."""
    async with GuardedApi() as api:
        port = None
        try:
            endpoint = Endpoint(api.endpoint.server)
            console = Console(endpoint, Seal(b"k" * 32), informers=InformerSets(idle_s=idle_s), **settings)
            if local:
                console.door = LocalDoor()
                console.api = console.endpoint_for(ADMIN)
                console.cookie = "robotapp-console-0"
            port = await serve(console, await listen("127.0.0.1", 0), limits=limits)
            if local:
                console.hosts = frozenset({f"127.0.0.1:{port.number}", f"localhost:{port.number}"})
            async with ClientSession(cookie_jar=DummyCookieJar()) as http:
                yield Stage(api, console, http, f"http://127.0.0.1:{port.number}")
        finally:
            if port is not None:
                await port.close()
