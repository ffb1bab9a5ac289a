"""Answers of /explain: the record of the decision as it was made, or, marked so, one made again now."""

from collections.abc import Callable, Iterable, Mapping
from datetime import timedelta
from typing import Any, Final

import msgspec

from robotapp_client.api.times import Now, micro_time, utc_now
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.cycle.re_evaluate import re_evaluate
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.explain.record import Record, as_json

RECOMPUTED: Final = "decided again just now, on the cluster as it is: not the decision that placed the pod"
NO_NODES: Final = "the table names nodes: it takes the right to get nodes"


class Explainer:
    """Explains pods by their records; a pod without a record (after a restart, or dropped) is evaluated again."""

    def __init__(
        self,
        core: SchedulerCore,
        *,
        waiting: Callable[[], Iterable[Pod]],
        digest: Callable[[], str],
        clock: Callable[[], float],
        now: Now = utc_now,
    ) -> None:
        """`clock` is the core's own; its times are shown as the `now` of that moment."""
        self._core = core
        self._clock = clock
        self._now = now
        self._waiting = waiting
        self._digest = digest

    def __repr__(self) -> str:
        return f"<Explainer {self._core.explain!r}>"

    def __call__(self, namespace: str, name: str, *, with_nodes: bool, full: bool) -> Mapping[str, Any] | None:
        """The explanation as JSON, None for a pod of another scheduler or one that is not in the cache."""
        recorded = None if full else self.recorded(namespace, name, with_nodes=with_nodes)
        if recorded is not None:
            return recorded
        record, pod = self._core.explain.find(namespace, name), self._pod(namespace, name)
        if pod is None:
            return None
        found = self._again(
            pod, recorded=None if record is None else self._with_times(record), full=full and with_nodes
        )
        if full and not with_nodes:
            found["note"] = NO_NODES
        return self._shown(found, with_nodes=with_nodes)

    def recorded(self, namespace: str, name: str, *, with_nodes: bool) -> Mapping[str, Any] | None:
        """The decision as it was made, None when it is not remembered. Takes no time."""
        record = self._core.explain.find(namespace, name)
        return (
            None
            if record is None
            else self._shown(self._with_times(record) | {"recomputed": False}, with_nodes=with_nodes)
        )

    def knows(self, namespace: str, name: str) -> bool:
        """Whether a pod of this scheduler can be evaluated again."""
        return self._pod(namespace, name) is not None

    def _shown(self, found: dict[str, Any], *, with_nodes: bool) -> dict[str, Any]:
        found["config"] = self._digest()
        if with_nodes and found.get("node"):
            found["edges"] = [edge | {"now": self._known(found["node"], edge)} for edge in found.get("edges", ())]
        return found if with_nodes else without_nodes(found)

    def _known(self, node: str, edge: Mapping[str, Any]) -> Any:
        """What is known by now of the way between the pod's node and the other end of a connection."""
        return msgspec.to_builtins(self._core.cluster.rtt.known(edge["peerNode"], node, edge["percentile"]))

    def _again(self, pod: Pod, *, recorded: dict[str, Any] | None, full: bool) -> dict[str, Any]:
        record, nodes = re_evaluate(self._core, pod)
        now = self._with_times(record)
        found = recorded | {"recomputed": False} if recorded else now | {"recomputed": True, "note": RECOMPUTED}
        if not recorded:
            found |= {"node": pod.spec.node_name or None, "chosenNow": now["node"]}
        if full:
            table = None if nodes is None else msgspec.to_builtins(nodes)
            found["full"] = {"recomputed": True, "note": RECOMPUTED, "node": now["node"], "message": now["message"]}
            found["full"]["table"] = table
        return found

    def _with_times(self, record: Record) -> dict[str, Any]:
        """A record with the time of day it was made at: the core's clock means nothing outside of the process."""
        plain = as_json(record)
        ago = timedelta(seconds=self._clock() - plain.pop("atS"))
        return plain | {"at": micro_time(self._now() - ago)}

    def _pod(self, namespace: str, name: str) -> Pod | None:
        """The newest version of a pod of this scheduler, placed (or assumed) or waiting."""
        for placed in self._core.cluster.placed_named(namespace, name):
            if placed.name == name and placed.pod.spec.scheduler_name in self._core.scheduler_names:
                return placed.pod
        for pod in self._waiting():
            if (pod.metadata.namespace, pod.metadata.name) == (namespace, name):
                return pod
        return None


def without_nodes(record: Mapping[str, Any]) -> dict[str, Any]:
    """The explanation for a user without the right to get nodes: reasons and counts, no node names."""
    hidden = {"top", "runnerUp", "edges", "full", "chosenNow"}
    shown = {key: value for key, value in record.items() if key not in hidden}
    return shown | {"refusals": [{**refusal, "examples": []} for refusal in record.get("refusals", ())]}
