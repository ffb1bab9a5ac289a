"""What a scenario has in its hands: a cluster, one scheduler, a namespace, a seeded random, and a watch to wait by."""

import json
import random
import secrets
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Final

from campaigns.rigs.stage import pod as make_pod
from campaigns.rigs.storage_live import delete_volume
from campaigns.scenarios.cluster import Cluster, Json, Room
from campaigns.scenarios.contenders import Contender, Running
from campaigns.scenarios.watch import ClusterWatch
from robotapp_api.model.names import Annotation, Label
from robotapp_client.api.resources import (
    EVENTS,
    NODES,
    PERSISTENTVOLUMECLAIMS,
    PODS,
    ROBOTAPPS,
    ROBOTCLAIMS,
    Resource,
)
from robotapp_testbed import ControlPlane

PATIENCE_S: Final = 60.0
"""For what takes a second or two on an idle machine."""
MARK: Final = "scenarios.test/known"
SMALL: Final = Room(50, 64)


@dataclass(frozen=True, slots=True)
class Verdict:
    """`kept` of `of` promises held; `reason` tells which did not, `figures` what was counted or measured besides."""

    kept: int
    of: int
    reason: str = ""
    figures: Mapping[str, float] = field(default_factory=dict)

    @property
    def met(self) -> bool:
        return self.kept == self.of


def judged(promises: Mapping[str, bool], **figures: float) -> Verdict:
    """One promise each, by the words that are told when it is broken."""
    broken = [text for text, kept in promises.items() if not kept]
    return Verdict(len(promises) - len(broken), len(promises), "; ".join(broken), figures)


class Place:
    """One scenario under one scheduler. Names of its pods begin with `prefix`: both schedulers share the namespace."""

    def __init__(
        self,
        cp: ControlPlane,
        watch: ClusterWatch,
        cluster: Cluster,
        *,
        running: Running,
        namespace: str,
        prefix: str,
        rng: random.Random,
        patience_s: float = PATIENCE_S,
    ) -> None:
        self.cp = cp
        self.watch = watch
        self.cluster = cluster
        self.running = running
        self.contender: Contender = running.contender
        self.namespace = namespace
        self.prefix = prefix
        self.rng = rng
        self.patience_s = patience_s
        self.volumes: list[str] = []
        """PersistentVolumes that the scenario created."""
        self._pods = PODS.path(namespace)

    # Pods

    def pod(self, name: str, *, room: Room = SMALL, node: str = "", **fields: Any) -> Json:
        """A pod for this scheduler; with `node` a node selector allows that node alone."""
        if node:
            fields["nodeSelector"] = {str(Label.HOSTNAME): node}
        return make_pod(
            f"{self.prefix}-{name}", scheduler=self.contender.scheduler_name, requests=room.requests, **fields
        )

    def create(self, *pods: Json) -> list[str]:
        """Create them in this order; their names."""
        for body in pods:
            self.cp.api.create(self._pods, body)
        return [body["metadata"]["name"] for body in pods]

    def delete(self, name: str) -> None:
        """Delete a pod and wait until it is gone."""
        self.cp.api.delete(f"{self._pods}/{name}?gracePeriodSeconds=0")
        self.until(lambda: self.stored(name) is None, what=lambda: f"{name} is still there")

    def stored(self, name: str) -> Json | None:
        return self.watch.get(PODS, f"{self.namespace}/{name}")

    def node_of(self, name: str) -> str:
        return str((self.stored(name) or {"spec": {}})["spec"].get("nodeName", ""))

    def refusal(self, name: str) -> Json:
        """The PodScheduled=False condition, or nothing."""
        conditions = (self.stored(name) or {}).get("status", {}).get("conditions", ())
        return next((each for each in conditions if each["type"] == "PodScheduled" and each["status"] == "False"), {})

    def until_settled(self, names: Sequence[str]) -> dict[str, str]:
        """Wait until each has a node or the reason why not; the nodes by name, empty for those without."""

        def settled() -> bool:
            return all(self.node_of(name) or self.refusal(name) for name in names)

        self.until(settled, what=lambda: f"neither bound nor refused: {self._waiting(names)}")
        return {name: self.node_of(name) for name in names}

    def until_bound(self, names: Sequence[str]) -> dict[str, str]:
        """Wait until each has a node; the nodes by name."""
        self.until(
            lambda: all(map(self.node_of, names)), what=lambda: f"not bound: {self._waiting(names, refused=True)}"
        )
        return {name: self.node_of(name) for name in names}

    def granted(self, name: str, annotation: Annotation) -> str:
        return str((self.stored(name) or {"metadata": {}})["metadata"].get("annotations", {}).get(str(annotation), ""))

    def told(self, name: str) -> str:
        """The pod's condition and the notes of its Events, as one text."""
        notes = [each.get("note", "") for each in self.watch.all(EVENTS, self.namespace) if _regards(each, name)]
        return "\n".join([f"{self.refusal(name).get('reason', '')} {self.refusal(name).get('message', '')}", *notes])

    def uid(self, name: str) -> str:
        return str((self.stored(name) or {"metadata": {}})["metadata"].get("uid", ""))

    def claims(self) -> list[Json]:
        """RobotClaims whose holder is in this namespace."""
        return [each for each in self.watch.all(ROBOTCLAIMS) if each["spec"]["holder"]["namespace"] == self.namespace]

    # Waiting

    def until(self, look: Callable[[], Any], *, what: Callable[[], str]) -> Any:
        return self.watch.until(look, within_s=self.patience_s, what=what)

    def until_told(self, name: str, text: str) -> None:
        """Wait until the pod's condition or an Event contains this text."""
        self.until(lambda: text in self.told(name), what=lambda: f"{name} is not told of {text}: {self.told(name)}")

    def until_known(self) -> None:
        """Return when the scheduler knows all nodes as they are now: it has bound a pod to the one that was changed last."""
        token, node = secrets.token_hex(4), self.rng.choice(self.cluster.nodes).name
        self.patch_node(node, {"metadata": {"labels": {MARK: token}}})
        body = make_pod(
            f"{self.prefix}-known-{token}", scheduler=self.contender.scheduler_name, nodeSelector={MARK: token}
        )
        (name,) = self.create(body)
        self.until_bound([name])
        self.delete(name)

    def patch_node(self, name: str, change: Mapping[str, Any]) -> None:
        self.cp.api.patch(NODES.path(None, name), change)

    @contextmanager
    def annotated(self, names: Sequence[str], annotation: Annotation, value: str) -> Iterator[None]:
        """Nodes with this annotation, known to the scheduler."""
        try:
            for name in names:
                self.patch_node(name, {"metadata": {"annotations": {str(annotation): value}}})
            self.until_known()
            yield
        finally:
            for name in names:
                self.patch_node(name, {"metadata": {"annotations": {str(annotation): None}}})

    def clear(self) -> None:
        """Delete what the scenario created and wait until it is gone."""
        for resource in (ROBOTAPPS, PODS, PERSISTENTVOLUMECLAIMS):
            self._delete_all(resource)
        self.until(lambda: not self.claims(), what=lambda: f"claims are left: {self.claims()}")
        for name in self.volumes:
            delete_volume(self.cp, name)
        self.volumes.clear()

    def _delete_all(self, resource: Resource) -> None:
        if not self.watch.all(resource, self.namespace):
            return
        self.cp.api.delete(f"{resource.path(self.namespace)}?gracePeriodSeconds=0")
        self.until(
            lambda: not self.watch.all(resource, self.namespace),
            what=lambda: (
                f"{resource.plural} are left: {[each['metadata']['name'] for each in self.watch.all(resource, self.namespace)]}"
            ),
        )

    def _waiting(self, names: Sequence[str], *, refused: bool = False) -> str:
        waiting = [name for name in names if not self.node_of(name) and (refused or not self.refusal(name))]
        return f"{len(waiting)} of {len(names)}, such as " + json.dumps(
            {name: self.refusal(name).get("message", "") for name in waiting[:2]}
        )


def _regards(event: Json, name: str) -> bool:
    return bool(event.get("regarding", {}).get("name") == name)
