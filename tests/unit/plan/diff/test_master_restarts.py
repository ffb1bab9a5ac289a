"""Restarts of ROS 1 nodes after their master: when they are due, and that they end."""

from datetime import datetime, timedelta
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.factories import VERSION, make_app, stored

from robotapp_api.model.names import Annotation, Label
from robotapp_operator.plan.diff.diff import Observed, plan, wanted_children
from robotapp_operator.plan.diff.master_restarts import (
    MOST_RESTARTS,
    NodeRestart,
    describe_restart,
    find_start,
    is_restart,
    plan_restarts,
    read_master_starts,
)
from robotapp_operator.plan.spec.desired import App, desired_of
from robotapp_operator.plan.spec.objects import ChildRef, Deployment, Pod

NOON = datetime.fromisoformat("2026-01-01T12:00:00Z")
NOETIC: dict[str, Any] = {"ros": {"distro": "noetic"}}
Children = dict[ChildRef, Observed]


def at(second: float) -> str:
    return f"{NOON + timedelta(seconds=second):%Y-%m-%dT%H:%M:%SZ}"


def pod(
    name: str,
    *,
    made: float,
    runs: float | None = None,
    restarts: int = 0,
    ended: str | None = None,
    ready: bool = True,
    beside: tuple[dict[str, Any], ...] = (),
    **meta: str,
) -> Pod:
    """Made and running since these seconds after noon; its container ended before that at `ended`. beside: other containers."""
    container: dict[str, Any] = {"name": name.partition("-")[0], "restartCount": restarts}
    container["state"] = (
        {"waiting": {"reason": "ContainerCreating"}} if runs is None else {"running": {"startedAt": at(runs)}}
    )
    if ended:
        container["lastState"] = {"terminated": {"exitCode": 1, "finishedAt": ended}}
    body = {
        "metadata": {"name": name, "creationTimestamp": at(made), **meta},
        "status": {
            "phase": "Running",
            "conditions": [{"type": "Ready", "status": str(ready)}],
            "containerStatuses": sorted([container, *beside], key=lambda status: str(status["name"])),
        },
    }
    return msgspec.convert(body, Pod)


def deployed(app: App, starts: dict[str, str] | None = None) -> Children:
    """The app's children as they are stored."""
    children = wanted_children(
        desired_of(app, ""), domain=None, parameters={}, running=True, master_starts=starts or {}
    )
    changes = plan(app, children, {}, version=VERSION, settled={}).changes
    return {change.child.ref: stored(change, app) for change in changes}


def restarts(observed: Children, master: list[Pod], **nodes: list[Pod]) -> dict[str, NodeRestart]:
    """What is to be done with these pods of the master and of the components."""
    deployments = [item for item in observed.values() if isinstance(item, Deployment)]
    pods = {}
    for item in deployments:
        name = item.metadata.labels.get(Label.COMPONENT, "")
        pods[item.metadata.uid] = nodes.get(name, []) if name else master
    return plan_restarts(deployments, pods)


def record(master: list[Pod], node: Pod, earlier: str = "") -> str:
    """The annotation of `driver` when it has this pod."""
    app = make_app(**NOETIC)
    return restarts(deployed(app, {"driver": earlier}), master, driver=[node])["driver"].record


def test_a_node_that_ran_before_its_master_was_replaced_is_restarted_and_a_later_one_is_not() -> None:
    master = [pod("master", made=60, runs=61)]
    assert record(master, pod("driver", made=0, runs=1)) == at(60)
    assert record(master, pod("driver", made=0, runs=62, restarts=1)) == "", "it has registered anew"
    assert record(master, pod("driver", made=50, runs=60)) == "", "of the same start"
    assert record(master, pod("driver", made=0)) == "", "it has yet to start"


def test_a_master_that_restarted_in_its_pod_has_lost_its_names_too() -> None:
    master = [pod("master", made=0, runs=70, restarts=1, ended=at(60))]
    assert record(master, pod("driver", made=0, runs=1)) == at(70)
    assert record(master, pod("driver", made=0, runs=65, restarts=1)) == "", "it waited for the new one"
    unknown = [pod("master", made=0, runs=70, restarts=1, ended="0001-01-01T00:00:00Z")]
    assert record(unknown, pod("driver", made=0, runs=1)) == at(70)


@pytest.mark.parametrize("name", ["a-sidecar", "z-sidecar"])
def test_what_runs_beside_a_node_does_not_count_because_the_kubelet_sorts_containers_by_name(name: str) -> None:
    """A sidecar that crashed once would hide that its node is unknown to the master, an older one would restart a registered node."""
    master = [pod("master", made=60, runs=61)]
    younger = ({"name": name, "restartCount": 1, "state": {"running": {"startedAt": at(70)}}},)
    assert record(master, pod("driver", made=0, runs=1, beside=younger)) == at(60)
    older = ({"name": name, "state": {"running": {"startedAt": at(1)}}},)
    assert record(master, pod("driver", made=0, runs=62, restarts=1, beside=older)) == ""


def test_a_first_start_restarts_nothing_however_long_its_images_take() -> None:
    master = [pod("master", made=1, runs=900)]
    assert record(master, pod("driver", made=0, runs=3)) == ""


@pytest.mark.parametrize(
    "master",
    [
        [],
        [pod("master", made=60, runs=61, ready=False)],
        [pod("master", made=60, runs=61, deletionTimestamp=at(62))],
    ],
    ids=["none", "not ready", "ending"],
)
def test_nothing_is_restarted_before_a_master_is_ready(master: list[Pod]) -> None:
    assert find_start(master) is None
    assert record(master, pod("driver", made=0, runs=1)) == ""


def test_one_start_of_a_master_restarts_a_component_once_whatever_its_clock_shows() -> None:
    master, behind = [pod("master", made=60, runs=61)], pod("driver", made=0, runs=1)
    once = record(master, behind)
    assert record(master, behind, once) == once
    assert record([pod("master", made=120, runs=121)], behind, once) == f"{at(60)},{at(120)}"


def test_a_master_that_ends_for_ever_restarts_the_nodes_five_times_a_day_and_then_they_are_named() -> None:
    starts, observed = "", deployed(make_app(**NOETIC))
    for number in range(2 * MOST_RESTARTS):
        observed = deployed(make_app(**NOETIC), {"driver": starts})
        master = [pod("master", made=0, runs=100 * number + 100, restarts=number + 1, ended=at(100 * number + 50))]
        result = restarts(observed, master, driver=[pod("driver-1", made=0, runs=100 * number)])["driver"]
        assert result.refused == (() if number < MOST_RESTARTS else ("driver-1",))
        starts = result.record
    assert len(starts.split(",")) == MOST_RESTARTS
    tomorrow = [pod("master", made=90_000, runs=90_001)]
    assert record(tomorrow, pod("driver", made=0, runs=1), starts).endswith(at(90_000))


@given(st.text(max_size=80))
def test_an_annotation_that_is_no_list_of_times_stays_until_a_restart_is_due(text: str) -> None:
    master, node = [pod("master", made=60, runs=61)], pod("driver", made=0, runs=1)
    assert record([], node, text) == text
    assert record(master, node, text).endswith(at(60))
    assert record(master, node, record(master, node, text)) == record(master, node, text)


@pytest.mark.parametrize(
    "text", ["9999-12-31T23:59:59-23:59", "1970-01-01T00:00:00+23:59", "0001-01-01T00:00:00+01:00"]
)
def test_a_time_at_the_ends_of_the_calendar_ends_no_plan(text: str) -> None:
    """Whoever may edit a Deployment may write such a record."""
    assert record([pod("master", made=60, runs=61)], pod("driver", made=0, runs=1), text).endswith(at(60))


def test_an_app_of_another_master_or_without_pods_has_nothing_to_restart() -> None:
    external = make_app(**NOETIC, ros1={"master": "External", "uri": "http://master:11311"})
    assert all(not result.record for result in restarts(deployed(external), []).values())


def test_the_restart_rolls_the_template_once_and_its_event_names_the_components() -> None:
    app = make_app(**NOETIC)
    observed, wanted = deployed(app), deployed_children(app, {"driver": at(60)})
    what = plan(app, wanted, observed, version=VERSION, settled={})
    (change,) = what.changes
    assert is_restart(change)
    assert read_master_starts(change.child.spec) == at(60)
    note = describe_restart(["driver"], at(60))
    assert note.startswith("the ROS master was started anew at 2026-01-01T12:01:00Z")
    again = observed | {change.child.ref: stored(change, app)}
    assert not plan(app, wanted, again, version=VERSION, settled={})


def deployed_children(app: App, starts: dict[str, str]) -> list[Any]:
    return wanted_children(desired_of(app, ""), domain=None, parameters={}, running=True, master_starts=starts)


@pytest.mark.parametrize(("writer", "held"), [("1.1.0", True), ("1.3.0", True)], ids=["older", "newer"])
def test_templates_of_another_operator_get_the_restart_and_nothing_else(writer: str, held: bool) -> None:
    app = make_app(**NOETIC, update={"operator": "OnDemand"})
    changes = plan(app, deployed_children(app, {}), {}, version=writer, settled={}).changes
    observed = {change.child.ref: stored(change, app, version=writer) for change in changes}
    for item in observed.values():  # as the other version rendered it
        if isinstance(item, Deployment):
            item.text = item.text.replace(b'"periodSeconds":2', b'"periodSeconds":3').replace(b'"terminal"', b'"t"')
            item.metadata.annotations[Annotation.CONTENT_HASH.value] = "of its own"
    what = plan(app, deployed_children(app, {"driver": at(60)}), observed, version=VERSION, settled={})
    (change,) = what.changes
    assert change.amended is not None
    assert change.child.component == "driver"
    assert read_master_starts(change.amended) == at(60)
    assert change.over is not None
    before = change.over.spec
    before["template"]["metadata"].setdefault("annotations", {})[Annotation.MASTER_STARTS.value] = at(60)
    assert change.amended == before
    assert bool(what.held) is (held and writer < VERSION)
