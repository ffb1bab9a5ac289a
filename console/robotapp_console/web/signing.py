"""Signing in and out, and the one-time address of the local console."""

import logging
import time
from typing import Final

from aiohttp import web

from robotapp_api.values.naming import DNS_LABEL
from robotapp_client import ClientError, Unauthorized
from robotapp_console.web import security
from robotapp_console.web.console import CALLER, CONSOLE, Console
from robotapp_console.web.guard import LOGIN_COOKIE, name_login, read_nonce, refuse_credentials
from robotapp_console.web.sessions import LONGEST_S, hash_token

log = logging.getLogger(__name__)
_MOST_TOKEN: Final = 16_384


async def show_login(request: web.Request) -> web.Response:
    """The login form; who is signed in already goes on."""
    console = request.app[CONSOLE]
    if console.door is not None:
        raise web.HTTPNotFound
    target = security.clean_next(request.query.get("next", "/"))
    if CALLER in request:
        return web.Response(status=303, headers={"Location": target})
    return _answer_form(console, request, target=target)


def _answer_form(
    console: Console, request: web.Request, *, target: str, problem: str = "", home: str = "", status: int = 200
) -> web.Response:
    nonce = read_nonce(request) or console.make_nonce()
    csrf = console.seal.sign(name_login(nonce))
    context = {"title": "Sign in", "csrf": csrf, "next": target, "problem": problem, "home": home}
    answer = web.Response(
        status=status, text=console.render(request, "login.html", context | {"caller": None}), content_type="text/html"
    )
    answer.set_cookie(
        LOGIN_COOKIE, nonce, httponly=True, samesite="Strict", secure=True, path="/login", max_age=LONGEST_S
    )
    return answer


async def sign_in(request: web.Request) -> web.Response:
    """Takes the form: the API server decides whether the token is valid."""
    console = request.app[CONSOLE]
    if console.door is not None:
        raise web.HTTPNotFound
    fields = await request.post()
    token, home = (str(fields.get(name, "")).strip() for name in ("token", "home"))
    target = security.clean_next(str(fields.get("next", "/")))
    token = token.removeprefix("Bearer ").strip()
    if not token or len(token) > _MOST_TOKEN or not (token.isascii() and token.isprintable()) or " " in token:
        return _answer_form(console, request, target=target, problem="That is no token.", home=home, status=422)
    if home and not DNS_LABEL.fullmatch(home):
        return _answer_form(console, request, target=target, problem="That is no name of a namespace.", status=422)
    key = hash_token(token)
    try:
        informers = await console.informers.get(key, console.endpoint_for(token))
        user = await informers.fetch_user()
        session, cookie = console.seal.open_session(token, user=user, home=home)
    except Unauthorized:
        await console.informers.drop(key)
        log.warning("sign-in from %s refused: the API server does not know the token", console.find_address(request))
        problem = "The API server does not know this token, or it has expired."
        return _answer_form(console, request, target=target, problem=problem, home=home, status=401)
    except ClientError as error:
        await console.informers.drop(key)
        problem = f"The API server cannot be reached: {error}"
        return _answer_form(console, request, target=target, problem=problem, home=home, status=503)
    except ValueError as error:
        problem = f"This token cannot be used here: {error}. Put an OIDC proxy in front of the console instead."
        return _answer_form(console, request, target=target, problem=problem, home=home, status=422)
    log.info("%s signed in from %s", user or "a user without a name", console.find_address(request))
    answer = web.Response(status=303, headers={"Location": target})
    answer.set_cookie(
        console.cookie,
        cookie,
        httponly=True,
        samesite="Strict",
        secure=True,
        path="/",
        max_age=max(1, int(session.ends_s - time.time())),
    )
    return answer


async def sign_out(request: web.Request) -> web.Response:
    """Ends the session: its cookie is worthless from now on, and so is a copy of it, in this process (`Seal.end_session`)."""
    console = request.app[CONSOLE]
    session = console.session_of(request)
    if session is not None:
        console.seal.end_session(session)
        await console.informers.drop(hash_token(session.token))
    answer = web.Response(status=303, headers={"Location": "/login"})
    _delete_cookie(console, answer)
    return answer


def answer_expired(request: web.Request) -> web.Response:
    """The answer to a caller whose token the API server does not accept any more."""
    console = request.app[CONSOLE]
    if console.door is not None or not request[CALLER].may_sign_out:
        return refuse_credentials(request)
    answer = web.Response(status=303, headers={"Location": "/login"})
    _delete_cookie(console, answer)
    return answer


def _delete_cookie(console: Console, answer: web.Response) -> None:
    answer.del_cookie(console.cookie, path="/", secure=True, httponly=True, samesite="Strict")


async def open_local(request: web.Request) -> web.Response:
    """Opens a session for the one-time address of the local console."""
    console = request.app[CONSOLE]
    if console.door is None:
        raise web.HTTPNotFound
    if CALLER in request:
        return web.Response(status=303, headers={"Location": "/"})
    session = console.door.open_session(request.query.get("pass", ""))
    if session is None:
        text = "It was used before, or it is of another console. Take the newest one that kubectl robotapp console printed."
        return console.answer_message(request, 401, "This address is not valid", text)
    console.on_opened()
    answer = web.Response(status=303, headers={"Location": "/"})
    answer.set_cookie(console.cookie, session, httponly=True, samesite="Strict", path="/")
    return answer
