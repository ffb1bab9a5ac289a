"""The testbed's own small blocking client: JSON over one kept-alive connection per thread."""

import http.client
import json
import ssl
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from http import HTTPStatus
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from robotapp_testbed.failures import ApiStatusError

_PARALLEL = 8
_TIMEOUT_S = 30.0
_REST_S = 30.0
_BUSY_S = 20.0
_BUSY_PAUSE_S = 0.2
MERGE = "application/merge-patch+json"
APPLY = "application/apply-patch+yaml"


class Api:
    """Raw access as one identity. Paths are complete (`/api/v1/nodes/edge-1/status`); objects are JSON trees.

    headers: of every request, such as those of impersonation.
    """

    def __init__(
        self,
        server_url: str,
        *,
        ca_file: Path,
        token: str,
        headers: Mapping[str, str] | None = None,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        parts = urlsplit(server_url)
        self._host, self._port = parts.hostname or "", parts.port
        self._ca_file = ca_file
        self._clock = clock
        self._sleep = sleep
        self._headers = {
            "Authorization": f"Bearer {token}",
            "Accept": "application/json",
            "User-Agent": "robotapp-testbed",
            **(headers or {}),
        }
        self._local = threading.local()
        self._opened: list[http.client.HTTPSConnection] = []

    def get(self, path: str) -> Any:
        return self.request("GET", path)

    def create(self, path: str, obj: Mapping[str, Any]) -> Any:
        return self.request("POST", path, obj)

    def patch(self, path: str, obj: Mapping[str, Any], *, content_type: str = MERGE) -> Any:
        return self.request("PATCH", path, obj, content_type=content_type)

    def delete(self, path: str) -> Any:
        return self.request("DELETE", path)

    def request(
        self, method: str, path: str, obj: Mapping[str, Any] | None = None, *, content_type: str = "application/json"
    ) -> Any:
        """The decoded answer (text when it is not JSON). ApiStatusError for an error status, OSError without a server."""
        status, body = self._send(method, path, obj, content_type)
        deadline_s = self._clock() + _BUSY_S
        while status == HTTPStatus.TOO_MANY_REQUESTS and self._clock() < deadline_s:
            # Not processed, so repeating is safe; seen right after a CRD is established ("storage is (re)initializing").
            self._sleep(_BUSY_PAUSE_S)
            status, body = self._send(method, path, obj, content_type)
        text = body.decode("utf-8", "replace")
        if status >= 400:
            try:
                message = json.loads(text)["message"]
            except (ValueError, KeyError, TypeError):
                message = text[:500]
            raise ApiStatusError(method, path, status, message)
        return json.loads(text) if text.startswith(("{", "[")) else text

    def stream(self, path: str, *, silence_s: float) -> http.client.HTTPSConnection:
        """A connection of its own on which the request was sent: `getresponse()` gives what comes bit by bit, such as a watch.

        OSError when nothing comes for `silence_s`. The caller closes it.
        """
        connection = http.client.HTTPSConnection(self._host, self._port, timeout=silence_s, context=self._context())
        connection.request("GET", path, headers=self._headers)
        return connection

    def each(self, action: Callable[[Any], object], items: Iterable[Any]) -> None:
        """Run `action` for all items on a few connections at once; the first error is raised."""
        with ThreadPoolExecutor(max_workers=_PARALLEL) as pool:
            list(pool.map(action, items))

    def is_ready(self) -> bool:
        try:
            return bool(self.get("/readyz") == "ok")
        except (OSError, http.client.HTTPException, ApiStatusError):
            return False

    def close(self) -> None:
        for connection in self._opened:
            connection.close()
        self._opened.clear()

    def _send(self, method: str, path: str, obj: Mapping[str, Any] | None, content_type: str) -> tuple[int, bytes]:
        body = None if obj is None else json.dumps(obj)
        headers = self._headers if body is None else {**self._headers, "Content-Type": content_type}
        connection, fresh = self._connection()
        try:
            connection.request(method, path, body=body, headers=headers)
            response = connection.getresponse()
            answer = response.status, response.read()
        except (OSError, http.client.HTTPException):
            self._local.connection = None
            connection.close()
            if fresh or method != "GET":  # a write may have been done: only the caller knows whether to repeat it
                raise
            return self._send(method, path, obj, content_type)  # the server was restarted since the last request
        self._local.used_s = self._clock()
        return answer

    def _connection(self) -> tuple[http.client.HTTPSConnection, bool]:
        """This thread's connection, and whether it is new. One that rested is replaced: the server closes idle ones after 90 s."""
        connection: http.client.HTTPSConnection | None = getattr(self._local, "connection", None)
        if connection is not None and self._clock() - self._local.used_s < _REST_S:
            return connection, False
        if connection is not None:
            connection.close()
        connection = http.client.HTTPSConnection(self._host, self._port, timeout=_TIMEOUT_S, context=self._context())
        self._local.connection, self._local.used_s = connection, self._clock()
        self._opened.append(connection)
        return connection, True

    def _context(self) -> ssl.SSLContext:
        return ssl.create_default_context(cafile=str(self._ca_file))
