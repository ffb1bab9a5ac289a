"""The parts that all handlers share: the API server, sessions, informers, templates, and who makes a request."""

import asyncio
import contextlib
import secrets
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from aiohttp import web

from robotapp_api.values.quantities.buckets import Buckets
from robotapp_client import Endpoint
from robotapp_client.serving.pages import find_network
from robotapp_client.serving.server import read_network
from robotapp_client.transport.credentials import Credentials
from robotapp_console.cluster.config_store import Place
from robotapp_console.cluster.informer_sets import InformerSets
from robotapp_console.cluster.scheduler_port import SchedulerPort
from robotapp_console.web.rendering import Pages, StaticFiles
from robotapp_console.web.sessions import Caller, LocalDoor, Seal, Session, hash_token

LOCAL: Final = "local"
"""Key of the local console's only caller."""
CALLER: Final = web.RequestKey("caller", Caller)
CALLER_PER_S, CALLER_AT_ONCE = 10.0, 60
STRANGERS_PER_S, STRANGERS_AT_ONCE = 5.0, 30


@dataclass(slots=True)
class Console:
    """The parts that the handlers share. `door` exists in the local console only; `seal` encrypts the cookies of the other one."""

    api: Endpoint
    """The API server; in the cluster without any credentials."""
    seal: Seal
    door: LocalDoor | None = None
    local_user: str = ""
    """How the API server names the user of the local console."""
    token_header: str = ""
    behind_proxy: bool = False
    """An ingress has TLS: it makes all connections, and says by X-Forwarded-For for whom."""
    hosts: frozenset[str] = frozenset()
    cookie: str = "__Host-robotapp-console"
    informers: InformerSets = field(default_factory=InformerSets)
    config_place: Place = field(default_factory=Place)
    """Where the scheduler's configuration is."""
    scheduler: SchedulerPort = field(default_factory=SchedulerPort)
    files: StaticFiles = field(default_factory=StaticFiles)
    pages: Pages = field(init=False)
    drafting: asyncio.Lock = field(default_factory=asyncio.Lock)
    """Configurations are checked one at a time, beside the loop, so that other pages are served meanwhile."""
    ending: asyncio.Event = field(default_factory=asyncio.Event)
    """Set when the process ends, so that streams do."""
    callers: Buckets = field(
        default_factory=lambda: Buckets(per_s=CALLER_PER_S, burst=CALLER_AT_ONCE, clock=time.monotonic)
    )
    strangers: Buckets = field(
        default_factory=lambda: Buckets(per_s=STRANGERS_PER_S, burst=STRANGERS_AT_ONCE, clock=time.monotonic)
    )
    on_opened: Callable[[], None] = field(default=lambda: None)
    """Called when a one-time address was used, so that the next one can be printed."""

    def __post_init__(self) -> None:
        self.pages = Pages(self.files)

    @staticmethod
    def make_nonce() -> str:
        """Returns a name for a browser without a session, which its login form is bound to."""
        return secrets.token_urlsafe(18)

    def endpoint_for(self, token: str) -> Endpoint:
        """Returns the way to the API server with this token and nothing else."""
        return Endpoint(
            self.api.server,
            security=self.api.security,
            credentials=Credentials.fixed(token),
            server_hostname=self.api.server_hostname,
            proxy=self.api.proxy,
        )

    def session_of(self, request: web.Request) -> Session | None:
        """Returns the session of the request's cookie."""
        cookie = request.cookies.get(self.cookie, "")
        return self.seal.read_session(cookie) if cookie else None

    def identify(self, request: web.Request) -> Caller | None:
        """Returns who makes the request: the local user, whom a proxy vouches for by a token, or who signed in."""
        if self.door is not None:
            session = request.cookies.get(self.cookie, "")
            is_open = self.door.is_open(session)
            return Caller(LOCAL, self.api, session, self.local_user, self.api.namespace) if is_open else None
        if self.token_header and (token := _read_header_token(request.headers.get(self.token_header, ""))):
            key = hash_token(token)
            return Caller(key, self.endpoint_for(token), key)
        signed_in = self.session_of(request)
        if signed_in is None:
            return None
        return Caller(
            hash_token(signed_in.token),
            self.endpoint_for(signed_in.token),
            signed_in.id,
            signed_in.user,
            signed_in.home,
            signed_in.ends_s,
            may_sign_out=True,
        )

    def find_address(self, request: web.Request) -> str:
        """Returns the address that makes the request; behind a proxy the one that the proxy itself added, which is the last."""
        if self.behind_proxy:
            hop = ",".join(request.headers.getall("X-Forwarded-For", [])).rpartition(",")[2].strip()
            with contextlib.suppress(ValueError):
                return read_network(hop)
        return find_network(request)

    def has_met(self, caller: Caller) -> bool:
        """Returns whether the caller's token was accepted before: a proxy hands over whatever it is given."""
        return self.door is not None or caller.may_sign_out or caller.key in self.informers

    def render(self, request: web.Request, template: str, context: Mapping[str, Any], *, now_s: float = 0.0) -> str:
        """Returns a whole page; what every page needs is added."""
        caller = request.get(CALLER)
        shared = {
            "caller": caller,
            "csrf": self.seal.sign(caller.session) if caller else "",
            "screen": "",
            "namespace": "",
            "notice": "",
        }
        return self.pages.render(template, shared | dict(context), now_s=now_s)

    def answer_message(self, request: web.Request, status: int, title: str, text: str, **more: Any) -> web.Response:
        """Returns a page with what is wrong; a program or a stream gets the text alone."""
        if "text/html" not in request.headers.get("Accept", "") or "HX-Request" in request.headers:
            return web.Response(status=status, text=f"{title}: {text}\n")
        context = {"title": title, "text": text, "commands": (), "links": {}} | more
        return web.Response(status=status, text=self.render(request, "message.html", context), content_type="text/html")


def _read_header_token(value: str) -> str:
    """Returns the token of a proxy's header, with or without the word Bearer; empty for what can be no token."""
    token = value[7:].strip() if value[:7].lower() == "bearer " else value.strip()
    return token if token.isascii() and token.isprintable() and " " not in token else ""


CONSOLE: Final = web.AppKey("console", Console)
