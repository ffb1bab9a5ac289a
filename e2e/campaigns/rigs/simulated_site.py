"""The whole product running on a small simulated site: nodes, telemetry, pools, operator, scheduler and a watch."""

import secrets
import time
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from types import TracebackType
from typing import Any, Self

from tests.support.apiobjects import ROS

from campaigns.rigs.appwatch import AppWatch
from robotapp_api.model.names import API_VERSION, OPERATOR_MANAGER, SCHEDULER_MANAGER, SYSTEM_NAMESPACE
from robotapp_testbed import ControlPlane, Process, wait_until
from robotapp_testbed.control_plane import product
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.failures import ApiStatusError
from robotapp_testbed.machines import topology
from robotapp_testbed.machines.network import Topology
from robotapp_testbed.machines.topology import SimulatedTelemetry

Object = dict[str, Any]
APIS = f"/apis/{API_VERSION}"
GONE_S = 120.0


class SimulatedSite:
    """The product running on simulated nodes. Everything is the test's own and gone afterwards, so that tests can share one control plane.

    `pools` are ids by pool name, with a quarantine of one second; the sweep runs every second. `operator_flags` and
    `scheduler_flags` are for the two processes, `telemetry_s` is the heartbeat of the simulated agents. Not `tidy`: the control plane is thrown away afterwards, so apps are left as they are.
    """

    def __init__(
        self,
        cp: ControlPlane,
        nodes: Topology,
        *,
        pools: Mapping[str, str] | None = None,
        operator_flags: Mapping[str, object] | None = None,
        scheduler_flags: Mapping[str, object] | None = None,
        telemetry_s: int | None = None,
        tidy: bool = True,
    ) -> None:
        self.cp = cp
        self.nodes = nodes
        self.namespace = f"journey-{secrets.token_hex(3)}"
        self.apps_path = f"{APIS}/namespaces/{self.namespace}/robotapps"
        self._pools = dict(pools or {})
        self._operator_flags = {"sweep_seconds": 1, **(operator_flags or {})}
        self._scheduler_flags = {"sweep_seconds": 1, **(scheduler_flags or {})}
        self._telemetry_s = telemetry_s
        self._tidy = tidy
        self._closing = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            for name, ids in self._pools.items():
                stack.callback(self._delete, f"{APIS}/domainpools/{name}")
                self.cp.api.create(f"{APIS}/domainpools", _pool(name, ids))
            stack.callback(topology.remove, self.cp, self.nodes)
            topology.apply(self.cp, self.nodes)
            self.telemetry = stack.enter_context(SimulatedTelemetry(self.cp, self.nodes, interval_s=self._telemetry_s))
            stack.enter_context(created(self.cp, self.namespace))
            self.watch = stack.enter_context(AppWatch(self.cp.kubeconfig(), self.namespace))
            self._forget_leases()
            self.operator = stack.enter_context(_ended(product.start_operator(self.cp, **self._operator_flags)))
            self.scheduler = stack.enter_context(_ended(product.start_scheduler(self.cp, **self._scheduler_flags)))
            if self._tidy:
                stack.callback(self.clear)
            self._closing = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._closing.__exit__(kind, error, trace)

    def another_operator(self, **flags: object) -> Process:
        """Start one more, without election; it ends with this site."""
        flags = {"name": "operator-2", "sweep_seconds": 1, "no_leader_election": True, **flags}
        return self._closing.enter_context(_ended(product.start_operator(self.cp, **flags)))

    def kubectl(self, *args: str, stdin: object = None, check: bool = True) -> str:
        """kubectl in the namespace of this site, as admin."""
        return self.cp.kubectl("-n", self.namespace, *args, stdin=stdin, check=check)

    # Apps

    def create(self, app: Mapping[str, Any]) -> float:
        """Create one app; the monotonic second at which the request was sent."""
        sent_s = time.monotonic()
        self.cp.api.create(self.apps_path, {**app, "metadata": {**app["metadata"], "namespace": self.namespace}})
        return sent_s

    def create_all(self, apps: Iterable[Mapping[str, Any]]) -> float:
        """Create many at once; the monotonic second at which the first request was sent."""
        sent_s = time.monotonic()
        self.cp.api.each(self.create, apps)
        return sent_s

    def app(self, name: str) -> Object:
        found: Object = self.cp.api.get(f"{self.apps_path}/{name}")
        return found

    def delete(self, *names: str) -> float:
        """Ask for the deletion of these apps; the monotonic second at which the last request was answered."""
        self.cp.api.each(lambda name: self.cp.api.delete(f"{self.apps_path}/{name}"), names)
        return time.monotonic()

    def clear(self) -> None:
        """Delete all apps and wait until none of their objects or claims is left."""
        if not wait_until(self._all_deleted, timeout_s=GONE_S, poll_s=0.2):
            raise AssertionError(f"the deletion of all apps was not answered within {GONE_S:.0f} s")
        if not wait_until(lambda: not self.left(), timeout_s=GONE_S, poll_s=0.2):
            raise AssertionError(f"left {GONE_S:.0f} s after deletion: {self.left()[:10]}")

    def _all_deleted(self) -> bool:
        """Whether the deletion was answered: that of hundreds outlasts one request on a busy machine, and may be repeated."""
        try:
            self.cp.api.delete(self.apps_path)
        except TimeoutError:
            return False
        return True

    def left(self) -> list[str]:
        """Objects of this site's apps that still exist, claims of pools with a longer quarantine not counted."""
        kinds = ("/apis/apps/v1", "deployments"), ("/api/v1", "pods"), (APIS, "robotapps")
        names = [
            f"{kind}/{item['metadata']['name']}"
            for prefix, kind in kinds
            for item in self.cp.api.get(f"{prefix}/namespaces/{self.namespace}/{kind}")["items"]
        ]
        quick = [
            claim for claim in self.claims() if claim["spec"].get("domain", {}).get("pool", "") in {*self._pools, ""}
        ]
        return names + [f"robotclaims/{claim['metadata']['name']}" for claim in quick]

    def claims(self, pool: str | None = None) -> list[Object]:
        """Claims held by apps of this site, of one pool if given."""
        return [
            claim
            for claim in self.cp.api.get(f"{APIS}/robotclaims")["items"]
            if claim["spec"]["holder"]["namespace"] == self.namespace
            and (pool is None or claim["spec"].get("domain", {}).get("pool") == pool)
        ]

    def pods(self) -> list[Object]:
        found: list[Object] = self.cp.api.get(f"/api/v1/namespaces/{self.namespace}/pods")["items"]
        return found

    def events(self, name: str) -> list[Object]:
        """Events about the app that has this name now."""
        uid = self.app(name)["metadata"]["uid"]
        path = f"/apis/events.k8s.io/v1/namespaces/{self.namespace}/events"
        return [each for each in self.cp.api.get(path)["items"] if each.get("regarding", {}).get("uid") == uid]

    def events_of_pods(self, uids: Collection[str]) -> list[Object]:
        """Events about the pods of these uids."""
        path = f"/apis/events.k8s.io/v1/namespaces/{self.namespace}/events"
        return [each for each in self.cp.api.get(path)["items"] if each.get("regarding", {}).get("uid") in uids]

    def _forget_leases(self) -> None:
        """A test before us may have killed its operator: nobody shall wait until its Lease runs out."""
        for name in (OPERATOR_MANAGER, SCHEDULER_MANAGER):
            self._delete(f"/apis/coordination.k8s.io/v1/namespaces/{SYSTEM_NAMESPACE}/leases/{name}")

    def _delete(self, path: str) -> None:
        try:
            self.cp.api.delete(path)
        except ApiStatusError as error:
            if error.status != 404:
                raise


@contextmanager
def _ended(process: Process) -> Iterator[Process]:
    try:
        yield process
    finally:
        process.kill()


def plain_app(name: str, *, parts: Sequence[str] = ("sense", "plan", "act"), **spec: Any) -> Object:
    """An app of components without wishes."""
    components = [{"name": part, "image": "registry.example/part:1"} for part in parts]
    return {
        "apiVersion": API_VERSION,
        "kind": "RobotApp",
        "metadata": {"name": name},
        "spec": {"ros": ROS, "components": components, **spec},
    }


def _pool(name: str, ids: str) -> Object:
    spec = {"scope": "Cluster", "network": name, "ids": ids, "quarantineSeconds": 1}
    return {"apiVersion": API_VERSION, "kind": "DomainPool", "metadata": {"name": name}, "spec": spec}
