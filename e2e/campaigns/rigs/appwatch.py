"""Sees every change of the RobotApps (or Deployments) of a namespace, and notes when each was first Ready at its generation."""

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

from campaigns.rigs.watching import WatchThread
from robotapp_client import ApiClient, Change, Reflector
from robotapp_client.api.resources import ROBOTAPPS, Resource

App = Mapping[str, Any]


class AppWatch(WatchThread):
    """A watch of one kind in one namespace.

    `apps` is the last state by name; `ready_s` the monotonic second at which that uid was first seen Ready. Another
    `resource` needs a `ready` of its own.
    """

    def __init__(
        self,
        kubeconfig: Path,
        namespace: str,
        *,
        resource: Resource = ROBOTAPPS,
        ready: Callable[[App], bool] | None = None,
    ) -> None:
        super().__init__(kubeconfig, f"watch on {resource.plural} of {namespace}")
        self._namespace = namespace
        self._resource = resource
        self._is_ready = ready or is_ready
        self._apps: dict[str, App] = {}
        self.apps: Mapping[str, App] = MappingProxyType(self._apps)
        self.ready_s: dict[str, float] = {}

    def until(self, condition: Callable[[Mapping[str, App]], object], *, within_s: float, what: str) -> float:
        """Block until `condition(apps)` holds, looking after every change; the monotonic second at which it did."""
        self.wait_for(
            lambda: condition(self.apps),
            within_s=within_s,
            what=lambda: f"{what}: not within {within_s:g} s; {self._unready()}",
        )
        return time.monotonic()

    def snapshot(self) -> dict[str, App]:
        """The apps as last seen, safe to iterate while the watch goes on."""
        with self._changed:
            return dict(self._apps)

    def until_ready(self, *names: str, within_s: float) -> float:
        """Block until these apps exist and are Ready; the monotonic second at which the last one was."""
        self.until(
            lambda apps: all(name in apps and self._is_ready(apps[name]) for name in names),
            within_s=within_s,
            what=f"{len(names)} {self._resource.plural} Ready",
        )
        return max(self.ready_s[self._apps[name]["metadata"]["uid"]] for name in names)

    def _reflectors(self, client: ApiClient) -> Sequence[Reflector[Any]]:
        return [
            Reflector(
                client, self._resource, as_type=dict, namespace=self._namespace, on_change=self._note, inactivity_s=300
            )
        ]

    def _note(self, change: Change) -> None:
        now_s = time.monotonic()
        with self._changed:
            name = change.key.partition("/")[2]
            if change.new is None:
                self._apps.pop(name, None)
            else:
                self._apps[name] = change.new
                if self._is_ready(change.new):
                    self.ready_s.setdefault(change.new["metadata"]["uid"], now_s)
            self._changed.notify_all()

    def _unready(self) -> str:
        waiting = [f"{name}: {condition(app, 'Ready')}" for name, app in self._apps.items() if not self._is_ready(app)]
        return f"{len(self._apps)} apps, {len(waiting)} not Ready, such as {waiting[:3]}"


def condition(app: App, kind: str) -> Mapping[str, Any]:
    """The named condition, or an empty one."""
    found = app.get("status", {}).get("conditions", [])
    return next((each for each in found if each["type"] == kind), {})


def is_available(deployment: App) -> bool:
    """All replicas of this spec are available."""
    status, meta = deployment.get("status", {}), deployment["metadata"]
    wanted = deployment["spec"].get("replicas", 1)
    return status.get("observedGeneration") == meta["generation"] and status.get("availableReplicas", 0) == wanted


def is_ready(app: App) -> bool:
    """Ready=True and said about the spec that is stored now."""
    ready = condition(app, "Ready")
    return ready.get("status") == "True" and ready.get("observedGeneration") == app["metadata"]["generation"]
