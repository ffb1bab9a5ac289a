"""Checks every request: the right Host, a known caller, not too often, and writes only from our own pages."""

import asyncio
import logging
import re
from collections.abc import Awaitable, Callable
from typing import Final
from urllib.parse import urlencode

from aiohttp import web

from robotapp_client import ClientError, Unauthorized
from robotapp_console.cluster.informer_sets import TooManyUsersError
from robotapp_console.views.texts import clean
from robotapp_console.web import security
from robotapp_console.web.console import CALLER, CONSOLE, Console
from robotapp_console.web.sessions import Caller

log = logging.getLogger(__name__)
Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]
_BODY_S: Final = 10.0
"""How long a form may take to arrive."""
_OPEN_PATHS: Final = frozenset({"/login", "/open"})
"""Paths without a session, besides static files and the health check."""


@web.middleware
async def answer_errors(request: web.Request, handler: Handler) -> web.StreamResponse:
    """Turns every failure into an answer without inner details."""
    console = request.app[CONSOLE]
    try:
        return await handler(request)
    except web.HTTPException as error:
        if error.status < 400:
            raise
        if isinstance(error, web.HTTPNotFound):
            text = f"The console has no page {clean(request.path, 200)}."
            return console.answer_message(request, 404, "Not found", text, links={"Fleet": "/"})
        text = error.text if isinstance(error, web.HTTPBadRequest) and error.text else error.reason
        return console.answer_message(request, error.status, error.reason, text or error.reason)
    except TooManyUsersError:
        return console.answer_message(
            request, 503, "Too many users", "Others look at the fleet. Try again in a minute."
        )
    except ConnectionResetError:
        raise
    except Exception:
        log.exception("%s %r failed", request.method, request.path)
        return console.answer_message(request, 500, "Internal error", "The console's log has the reason.")


@web.middleware
async def guard(request: web.Request, handler: Handler) -> web.StreamResponse:
    """Lets through what may pass: the right Host, a known caller, not too often, and writes only from our own pages."""
    console = request.app[CONSOLE]
    if request.path == "/healthz":  # probes use the address, and nothing is shown
        return await handler(request)
    if problem := security.find_host_problem(request, console.hosts):
        return web.Response(status=403, text=f"Refused: {problem}.\n")
    if request.path.startswith("/static/"):
        return await handler(request)
    caller = console.identify(request)
    wait_s = (
        console.callers.wait_s(caller.key)
        if caller and console.has_met(caller)
        else console.strangers.wait_s(console.find_address(request))
    )
    if wait_s:
        answer = console.answer_message(request, 429, "Too many requests", "Wait a moment, then load the page again.")
        answer.headers["Retry-After"] = str(int(wait_s) + 1)
        return answer
    if caller is not None:
        if not await _is_known(console, caller):
            return refuse_credentials(request)
        request[CALLER] = caller
    if request.method not in security.SAFE_METHODS and (refusal := await _find_write_problem(console, request, caller)):
        log.warning("refused %s %r: %s", request.method, request.path, refusal)
        return console.answer_message(request, 403, "Refused", f"{refusal[0].upper()}{refusal[1:]}.")
    if caller is None and request.path not in _OPEN_PATHS:
        return ask_to_sign_in(request)
    return await handler(request)


LOGIN_COOKIE: Final = "robotapp-console-login"
"""The cookie that the CSRF token of the login form belongs to, before there is a session."""
_NONCE: Final = re.compile(r"[A-Za-z0-9_-]{24}")


def read_nonce(request: web.Request) -> str:
    """Returns the name that a login form gave this browser, empty for what no form gives."""
    nonce = request.cookies.get(LOGIN_COOKIE, "")
    return nonce if _NONCE.fullmatch(nonce) else ""


def name_login(nonce: str) -> str:
    """Returns what the CSRF token of a login form is made for: it can be no session, whatever a browser sends as its nonce."""
    return f"login\n{nonce}"


async def _is_known(console: Console, caller: Caller) -> bool:
    """Returns whether the API server may know the caller's token: one that a stranger made up holds no place of a user."""
    if console.has_met(caller):
        return True
    informers = await console.informers.get(caller.key, caller.endpoint)
    try:
        await informers.fetch_user()
    except Unauthorized:
        await console.informers.drop(caller.key)
        return False
    except ClientError as error:  # the pages say so, too
        log.warning("the API server cannot say whether a token is valid: %s", error)
    return True


async def _find_write_problem(console: Console, request: web.Request, caller: Caller | None) -> str:
    """Returns why a write is refused, empty when it is not."""
    if problem := security.find_origin_problem(request):
        return problem
    if caller and request.path != "/login":
        session = caller.session
    else:
        nonce = read_nonce(request)
        session = name_login(nonce) if nonce else ""
    try:
        async with asyncio.timeout(_BODY_S):
            fields = await request.post()
    except TimeoutError:
        raise web.HTTPRequestTimeout from None
    signature = fields.get("csrf", "")
    if not session or not isinstance(signature, str) or not console.seal.is_signed(session, signature):
        return "the form is too old or not of this console (CSRF token); load the page again"
    return ""


def refuse_credentials(request: web.Request) -> web.Response:
    """Returns the answer to who comes with credentials that were made elsewhere, and that the API server does not accept."""
    text = "Sign in again where the credentials come from, then load this page again."
    title = "The API server does not accept the credentials"
    return request.app[CONSOLE].answer_message(request, 401, title, text)


def ask_to_sign_in(request: web.Request) -> web.Response:
    """Returns the answer to who has no session: people get the login form, programs 401.

    Who follows a link from another site may well have a session: strict cookies are not sent with that request, but with the
    next one, which the page itself makes.
    """
    console = request.app[CONSOLE]
    if request.headers.get("Sec-Fetch-Site") == "cross-site" and request.headers.get("Sec-Fetch-Mode") == "navigate":
        page = console.render(
            request, "again.html", {"title": "One moment", "path": security.clean_next(request.path_qs)}
        )
        return web.Response(status=401, text=page, content_type="text/html")
    wants_page = request.method in security.SAFE_METHODS and "text/html" in request.headers.get("Accept", "")
    if console.door is not None:
        text = "Open the address that kubectl robotapp console printed. It works once; after that a new one is printed."
        return console.answer_message(request, 401, "No session", text)
    if not wants_page or "HX-Request" in request.headers:
        return web.Response(status=401, text="Sign in first.\n", headers={"WWW-Authenticate": "Bearer"})
    return web.Response(status=303, headers={"Location": _login_path(request)})


def _login_path(request: web.Request) -> str:
    target = security.clean_next(request.path_qs)
    return "/login" if target == "/" else "/login?" + urlencode({"next": target})
