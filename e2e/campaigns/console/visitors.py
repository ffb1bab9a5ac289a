"""People in front of the console: they sign in, load pages, and keep some open."""

import asyncio
import re
import time
from collections.abc import AsyncIterable, AsyncIterator
from contextlib import asynccontextmanager
from http.cookies import SimpleCookie
from types import TracebackType
from typing import Final, Self

from aiohttp import ClientSession, ClientTimeout, DummyCookieJar, TCPConnector

_ANSWER_S: Final = 60.0
_CSRF: Final = re.compile(r'name="csrf" value="([^"]+)"')


class Visitor:
    """One signed-in user with any number of open pages."""

    def __init__(self, origin: str) -> None:
        self._origin = origin
        self._cookies: dict[str, str] = {}
        self._http = ClientSession(
            cookie_jar=DummyCookieJar(), connector=TCPConnector(limit=0), timeout=ClientTimeout(total=_ANSWER_S)
        )

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self._http.close()

    async def sign_in(self, token: str) -> None:
        """Signs in with a bearer token. Raises ConnectionError when the console refuses it."""
        _, _, form = await self.load("/login")
        csrf = _CSRF.search(form)
        fields = {"token": token, "home": "", "next": "/", "csrf": csrf[1] if csrf else ""}
        headers = self._make_headers() | {"Origin": self._origin}
        async with self._http.post(
            f"{self._origin}/login", data=fields, headers=headers, allow_redirects=False
        ) as answer:
            self._keep_cookies(answer.headers.getall("Set-Cookie", []))
            if answer.status != 303:
                raise ConnectionError(f"the console answered {answer.status} to the sign-in: {await answer.text()}")

    async def load(self, path: str) -> tuple[int, float, str]:
        """Returns status, seconds and text of a page."""
        began_s = time.monotonic()
        async with self._http.get(self._origin + path, headers=self._make_headers(), allow_redirects=False) as answer:
            self._keep_cookies(answer.headers.getall("Set-Cookie", []))
            text = await answer.text()
            return answer.status, time.monotonic() - began_s, text

    @asynccontextmanager
    async def follow(self, path: str) -> AsyncIterator["OpenPage"]:
        """Keeps a page open: what its stream sends arrives in the page."""
        timeout = ClientTimeout(total=None, sock_connect=_ANSWER_S)
        async with self._http.get(self._origin + path, headers=self._make_headers(), timeout=timeout) as answer:
            if answer.status != 200:
                raise ConnectionError(f"the console answered {answer.status} to {path}")
            page = OpenPage()
            reading = asyncio.create_task(page.read(answer.content))
            try:
                yield page
            finally:
                reading.cancel()

    def _make_headers(self) -> dict[str, str]:
        cookies = "; ".join(f"{name}={value}" for name, value in self._cookies.items())
        return {"Accept": "text/html", "Cookie": cookies}

    def _keep_cookies(self, lines: list[str]) -> None:
        for line in lines:
            self._cookies |= {name: morsel.value for name, morsel in SimpleCookie(line).items()}


class OpenPage:
    """A page that follows the cluster: its content now, and when it came."""

    def __init__(self) -> None:
        self.content = ""
        self.fragments = 0
        self._arrived = asyncio.Event()

    async def read(self, stream: AsyncIterable[bytes]) -> None:
        """Takes in fragments until cancelled."""
        lines: list[str] = []
        async for raw in stream:
            line = raw.decode().rstrip("\n")
            if line.startswith("data: "):
                lines.append(line[6:])
            elif not line and lines:
                self.content = "\n".join(lines)
                self.fragments += 1
                lines = []
                self._arrived.set()

    async def wait_for(self, pattern: re.Pattern[str], *, within_s: float) -> float:
        """Returns the seconds until the content matches. Raises TimeoutError."""
        began_s = time.monotonic()
        async with asyncio.timeout(within_s):
            while not pattern.search(self.content):
                self._arrived.clear()
                await self._arrived.wait()
        return time.monotonic() - began_s
