"""Rights of one user, as the API server's authorizers decide them; kept for half a minute."""

import asyncio
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Final

from robotapp_client import ApiClient, ClientError
from robotapp_client.api.resources import SELF_ACCESS_REVIEWS, Resource

KEPT_S: Final = 30.0
_MOST_KEPT: Final = 1024


@dataclass(frozen=True, slots=True)
class Right:
    """One verb on one resource. An empty `name` means all objects, an empty `namespace` all namespaces or a cluster-wide kind."""

    verb: str
    resource: Resource
    namespace: str = ""
    name: str = ""

    @property
    def words(self) -> str:
        """The right as a sentence names it, such as `patch robotapps teleop in namespace team-a`."""
        group = f".{self.resource.group}" if self.resource.group else ""
        words = f"{self.verb} {self.resource.plural}{group} {self.name}".rstrip()
        return f"{words} in namespace {self.namespace}" if self.namespace else words


class Rights:
    """Asks for each right once in `KEPT_S`; what the API server decides in the write itself counts all the same."""

    def __init__(self, client: ApiClient, *, clock: Callable[[], float] = time.monotonic) -> None:
        self._client = client
        self._clock = clock
        self._answers: dict[Right, tuple[float, bool]] = {}

    def __repr__(self) -> str:
        return f"<Rights {len(self._answers)} answers>"

    async def is_granted(self, right: Right, *, fresh: bool = False) -> bool:
        """Returns whether the user has the right. Raises ClientError when the API server does not answer."""
        entry = self._answers.get(right)
        if entry is not None and not fresh and self._clock() - entry[0] < KEPT_S:
            return entry[1]
        review = await self._client.create(SELF_ACCESS_REVIEWS, _encode_review(right))
        is_allowed = (review.get("status") or {}).get("allowed") is True
        if len(self._answers) >= _MOST_KEPT:
            self._answers.pop(next(iter(self._answers)))
        self._answers[right] = (self._clock(), is_allowed)
        return is_allowed

    async def select_granted(self, rights: Iterable[Right]) -> frozenset[Right]:
        """Returns those the user has. One that cannot be found out counts as missing: its button is not shown."""
        distinct_rights = tuple(dict.fromkeys(rights))
        answers = await asyncio.gather(*(self.is_surely_granted(right) for right in distinct_rights))
        return frozenset(right for right, is_granted in zip(distinct_rights, answers, strict=True) if is_granted)

    async def is_surely_granted(self, right: Right) -> bool:
        """Returns whether the user has the right; False when that cannot be found out."""
        try:
            return await self.is_granted(right)
        except ClientError:
            return False


def _encode_review(right: Right) -> dict[str, object]:
    attributes = {
        "verb": right.verb,
        "group": right.resource.group,
        "resource": right.resource.plural,
        "namespace": right.namespace,
        "name": right.name,
    }
    return {"spec": {"resourceAttributes": {key: value for key, value in attributes.items() if value}}}
