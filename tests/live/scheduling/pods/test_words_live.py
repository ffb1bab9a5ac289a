"""What a person reads about a pod: the same Events and conditions from kube-scheduler and from ours, field by field."""

import re
import secrets
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from campaigns.rigs.stage import Json, Stage, container, nodes, pod
from campaigns.rigs.twin import THEIRS, kube_scheduler
from robotapp_api.model.names import SCHEDULER_NAME
from robotapp_testbed import ControlPlane
from robotapp_testbed.machines.nodes import edge
from robotapp_testbed.processes.process import Process

pytestmark = pytest.mark.live
LONG = [f"{'long-name-' * 20}{number}.example.com/{'x' * 60}{number}" for number in range(5)]
FIELD = "requiredDuringSchedulingIgnoredDuringExecution"


def named(*terms: list[str]) -> Json:
    """An affinity to nodes of these names; the lists of one term exclude each other."""
    found = [
        {"matchFields": [{"key": "metadata.name", "operator": "In", "values": [name]} for name in term]}
        for term in terms
    ]
    return {"nodeAffinity": {FIELD: {"nodeSelectorTerms": found}}}


CASES: dict[str, Callable[[Stage], Json]] = {
    "more than an Event holds": lambda _: {"containers": [container(resources=dict.fromkeys(("requests", "limits"), dict.fromkeys(LONG, "1")))]},
    "several reasons": lambda stage: {"requests": {"cpu": "64", "memory": "1Ti"}, "nodeSelector": {"test/words": stage.namespace}},
    "nodes that are not there": lambda _: {"affinity": named(["nowhere"])},
    "names that exclude each other": lambda _: {"affinity": named(["a", "b"])},
    "a claim that is not there": lambda _: {"volumes": [{"name": "v", "persistentVolumeClaim": {"claimName": "none"}}]},
}  # fmt: skip


def told(stage: Stage, name: str, reason: str) -> Json:
    """The first Event of this reason, without what must differ: names, times, versions."""
    event = stage.wait_event(name, reason=reason)
    found = {
        key: event[key] for key in ("type", "reason", "action", "note", "reportingController", "reportingInstance")
    }
    found["regarding"] = sorted(event["regarding"])
    found["related"] = event.get("related")
    return {key: neutral(value, name) for key, value in found.items()}


def neutral(value: Any, name: str) -> Any:
    return re.sub(rf"{name}|{THEIRS}|{SCHEDULER_NAME}", "*", value) if isinstance(value, str) else value


def condition(stage: Stage, name: str) -> Json:
    (found,) = [each for each in stage.pod(name)["status"]["conditions"] if each["type"] == "PodScheduled"]
    return {key: value for key, value in found.items() if key != "lastTransitionTime"}


def test_refusals_and_placements_are_told_alike(
    installed_plane: ControlPlane, scheduler: Process, stage: Stage, tmp_path: Path
) -> None:
    assert scheduler.running
    label = {"test/words": stage.namespace}
    prefix = f"w-{secrets.token_hex(3)}"
    with (
        kube_scheduler(installed_plane, tmp_path),
        nodes(installed_plane, edge(f"{prefix}-1", labels=label), edge(f"{prefix}-2")),
    ):
        for who in (THEIRS, SCHEDULER_NAME):
            stage.wait_known(f"{prefix}-1", f"{prefix}-2", scheduler=who)
        pairs = []
        for number, (what, spec) in enumerate(CASES.items()):
            pair = {who: f"{short}-{number}" for who, short in ((THEIRS, "theirs"), (SCHEDULER_NAME, "ours"))}
            for who, name in pair.items():
                stage.create_pod(pod(name, scheduler=who, **spec(stage)))
            pairs.append((what, pair[THEIRS], pair[SCHEDULER_NAME]))
        for what, theirs, ours in pairs:
            stage.wait_refused(theirs, reason="Unschedulable")
            stage.wait_refused(ours, reason="Unschedulable")
            assert condition(stage, ours) == condition(stage, theirs), what
            assert told(stage, ours, "FailedScheduling") == told(stage, theirs, "FailedScheduling"), what
        assert len(told(stage, pairs[0][2], "FailedScheduling")["note"].encode()) == 1024
        for who, name in ((THEIRS, "theirs"), (SCHEDULER_NAME, "ours")):
            stage.create_pod(pod(name, scheduler=who, nodeSelector=label))
            stage.wait_bound(name)
        said = told(stage, "ours", "Scheduled")
        assert said == told(stage, "theirs", "Scheduled")
        assert said["reportingInstance"] == f"*-{socket.gethostname()}"
        assert condition(stage, "ours") == condition(stage, "theirs")
