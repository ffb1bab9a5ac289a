"""One watch on everything the scenarios wait for."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final, TypeVar

from campaigns.rigs.watching import WatchThread
from robotapp_client import ApiClient, Change, Reflector
from robotapp_client.api.resources import (
    EVENTS,
    PERSISTENTVOLUMECLAIMS,
    PODS,
    ROBOTAPPS,
    ROBOTCLAIMS,
    Resource,
)

T = TypeVar("T")
Json = dict[str, Any]
WATCHED: Final = (PODS, EVENTS, ROBOTCLAIMS, PERSISTENTVOLUMECLAIMS, ROBOTAPPS)


class ClusterWatch(WatchThread):
    """The last state of all pods, Events, claims, volume claims and apps. Conditions are checked after every change."""

    def __init__(self, kubeconfig: Path) -> None:
        super().__init__(kubeconfig, "watch on the cluster")
        self._objects: dict[str, dict[str, Json]] = {resource.plural: {} for resource in WATCHED}

    def get(self, resource: Resource, key: str) -> Json | None:
        """One object by `namespace/name`, or by name where its kind has no namespace."""
        with self._changed:
            return self._objects[resource.plural].get(key)

    def all(self, resource: Resource, namespace: str = "") -> list[Json]:
        """All objects of a kind, or those of one namespace."""
        with self._changed:
            found = self._objects[resource.plural].values()
            return [each for each in found if namespace in ("", each["metadata"].get("namespace"))]

    def until(self, look: Callable[[], T], *, within_s: float, what: Callable[[], str]) -> T:
        """The first true value of `look`, which is called after every change. Raises TimeoutError with the text of `what`."""
        return self.wait_for(look, within_s=within_s, what=lambda: f"not within {within_s:.0f} s: {what()}")

    def _reflectors(self, client: ApiClient) -> Sequence[Reflector[Json]]:
        return [
            Reflector(client, resource, as_type=dict, on_change=self._note(resource), inactivity_s=300)
            for resource in WATCHED
        ]

    def _note(self, resource: Resource) -> Callable[[Change], None]:
        objects = self._objects[resource.plural]

        def note(change: Change) -> None:
            with self._changed:
                if change.new is None:
                    objects.pop(change.key, None)
                else:
                    objects[change.key] = change.new
                self._changed.notify_all()

        return note
