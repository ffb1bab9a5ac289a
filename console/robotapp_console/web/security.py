"""Rules for every request and answer: headers, Host, Origin, CSRF tokens."""

from collections.abc import Collection
from typing import Final
from urllib.parse import urlsplit

from aiohttp import web

SAFE_METHODS: Final = frozenset({"GET", "HEAD"})
POLICY: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self'; font-src 'self'; "
    "form-action 'self'; frame-ancestors 'none'; base-uri 'none'"
)
HEADERS: Final = {
    "Content-Security-Policy": POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "same-origin",  # no-referrer would make browsers send `Origin: null` with forms
    "X-Frame-Options": "DENY",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Server": "robotapp-console",
    "Permissions-Policy": "camera=(), geolocation=(), microphone=()",
}


async def add_headers(request: web.Request, response: web.StreamResponse) -> None:
    """Adds the security headers to every answer. Nothing is cached unless the answer allows it."""
    del request
    response.headers.update(HEADERS)
    response.headers.setdefault("Cache-Control", "no-store")


def find_host_problem(request: web.Request, hosts: Collection[str]) -> str:
    """Returns why the Host header is refused, empty when it is not. A page of another name could rebind it to our address."""
    if not hosts or request.host in hosts:
        return ""
    return "this console is not reached under that name"


def find_origin_problem(request: web.Request) -> str:
    """Returns why a write is refused: it must come from a page of ours. Every browser names the origin of a form."""
    origin = request.headers.get("Origin", "")
    if not origin or origin == "null":
        return "the request does not name the page it comes from (header Origin)"
    if urlsplit(origin).netloc != request.host:
        return "the request comes from another site"
    return ""


def clean_next(path: str) -> str:
    """Returns a path of this console to go to after signing in, `/` for anything else."""
    if not path.startswith("/") or path.startswith(("//", "/\\")) or not path.isprintable() or "\\" in path:
        return "/"
    return path
