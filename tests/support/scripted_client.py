"""An ApiClient whose answers are written in the test: for logic around writes, where order and errors matter.

Everything about the wire itself is tested against a real server elsewhere.
"""

from collections import deque
from collections.abc import Callable
from typing import Any

from robotapp_client.api.resources import Resource
from robotapp_client.transport.errors import ClientError, Unreachable

Answer = Any
"""A value to return, or an exception to raise, or a function of the call."""


class ScriptedClient:
    """Answers calls in order from per-method scripts, and records every call as (method, path or name, body)."""

    def __init__(self) -> None:
        self.calls: list[tuple[str, str, Any]] = []
        self.slept_s: list[float] = []
        self.scripts: dict[str, deque[Answer]] = {}
        self.fallback: dict[str, Answer] = {}
        self.now_s = 0.0

    def script(self, method: str, *answers: Answer) -> "ScriptedClient":
        self.scripts.setdefault(method, deque()).extend(answers)
        return self

    def always(self, method: str, answer: Answer) -> "ScriptedClient":
        self.fallback[method] = answer
        return self

    def methods(self) -> list[str]:
        return [method for method, _, _ in self.calls]

    def clock(self) -> float:
        return self.now_s

    @staticmethod
    def uniform() -> float:
        return 0.0

    async def sleep(self, seconds: float) -> None:
        self.slept_s.append(seconds)
        self.now_s += seconds

    async def post_raw(self, path: str, body: bytes, *, permitted: Callable[[], bool] = lambda: True) -> Any:
        if not permitted():
            raise Unreachable("not permitted", maybe_applied=False)
        return self._answer("post_raw", path, body)

    def post_soon(
        self,
        path: str,
        body: bytes,
        done: Callable[[ClientError | None], None],
        *,
        permitted: Callable[[], bool] = lambda: True,
    ) -> None:
        """Done at once."""
        try:
            if not permitted():
                raise Unreachable("not permitted", maybe_applied=False)
            self._answer("post_soon", path, body)
        except ClientError as error:
            done(error)
        else:
            done(None)

    async def get(self, resource: Resource, name: str, *, namespace: str | None = None, as_type: Any = dict) -> Any:
        return self._answer("get", resource.path(namespace, name), as_type)

    async def create(self, resource: Resource, obj: Any, *, namespace: str | None = None) -> Any:
        return self._answer("create", resource.path(namespace), obj)

    async def patch(
        self,
        resource: Resource,
        name: str,
        patch: Any,
        *,
        namespace: str | None = None,
        subresource: str = "",
        content_type: str = "",
    ) -> Any:
        return self._answer("patch", resource.path(namespace, name, subresource), (content_type, patch))

    async def apply(
        self, resource: Resource, obj: Any, *, namespace: str | None = None, subresource: str = "", force: bool = True
    ) -> Any:
        where = resource.path(namespace or obj["metadata"].get("namespace"), obj["metadata"]["name"], subresource)
        assert force, "our writers own what they apply"
        return self._answer("apply", where, obj)

    async def delete(
        self,
        resource: Resource,
        name: str,
        *,
        namespace: str | None = None,
        uid: str | None = None,
        resource_version: str | None = None,
        propagation: str | None = None,
    ) -> Any:
        condition = {"uid": uid, "resourceVersion": resource_version, "propagation": propagation}
        return self._answer("delete", resource.path(namespace, name), condition)

    def _answer(self, method: str, path: str, body: Any) -> Any:
        self.calls.append((method, path, body))
        script = self.scripts.get(method)
        if script:
            answer = script.popleft()
        elif method in self.fallback:
            answer = self.fallback[method]
        else:
            raise AssertionError(f"unexpected {method} {path}")
        if isinstance(answer, Callable):  # type: ignore[arg-type]
            answer = answer(path, body)
        if isinstance(answer, BaseException):
            raise answer
        return answer
