"""Whether a component has a ResourceClaim: decided when it starts, kept while it runs, whatever happens to the driver."""

from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.factories import component, make_app, make_node

from robotapp_api.model.names import Annotation
from robotapp_operator.plan.diff.diff import wanted_children
from robotapp_operator.plan.render.devices.ledger import (
    NO_DRIVER,
    DriverNodes,
    claiming_components,
    describe_ledger,
    list_handover_notes,
)
from robotapp_operator.plan.spec.desired import App, Domain, desired_of
from robotapp_operator.plan.spec.objects import ChildRef, Deployment

LIDAR: dict[str, Any] = {"name": "lidar", "type": "serial"}
LABELS = {
    name: make_node(name, robot=name, tier="robot").metadata.labels
    if name.startswith("amr")
    else make_node(name, tier="edge").metadata.labels
    for name in ("amr-07", "amr-08", "edge-1")
}
ALL = DriverNodes(frozenset(LABELS), LABELS)


def on(*nodes: str) -> DriverNodes:
    return DriverNodes(frozenset(nodes), {name: LABELS[name] for name in nodes})


def driving(**fields: Any) -> App:
    return make_app(component("driver", devices=[LIDAR], **fields))


def stored(app: App, *, claiming: bool, replicas: int = 1) -> dict[ChildRef, Deployment]:
    """The Deployment as it is after it was written once."""
    names = frozenset({"driver"}) if claiming else frozenset[str]()
    children = wanted_children(desired_of(app, "amr-07"), domain=Domain(7), parameters={}, running=True, claiming=names)
    (child,) = (child for child in children if child.component == "driver")
    body = child.body(app, version="1.0")
    body["spec"] = {**body["spec"], "replicas": replicas}
    body["metadata"]["uid"] = "d"
    return {child.ref: msgspec.convert(body, Deployment)}


def decide(app: App, observed: Any, drivers: DriverNodes, *, placed: bool = False) -> bool:
    names = frozenset({"driver"}) if placed else frozenset[str]()
    return "driver" in claiming_components(desired_of(app, "amr-07"), observed, drivers, placed=names)


@pytest.mark.parametrize(("drivers", "expected"), [(NO_DRIVER, False), (on("amr-08"), False), (on("amr-07"), True)])
def test_a_new_component_has_a_claim_where_a_node_that_may_run_it_has_the_driver(
    drivers: DriverNodes, expected: bool
) -> None:
    assert decide(driving(runsOn=["Robot"]), {}, drivers) is expected


@given(st.booleans(), st.frozensets(st.sampled_from(sorted(LABELS))))
def test_no_driver_that_comes_or_goes_changes_a_component_that_runs(claiming: bool, nodes: frozenset[str]) -> None:
    app = driving()
    observed = stored(app, claiming=claiming)
    assert decide(app, observed, on(*nodes), placed=True) is claiming


def test_a_pod_that_waits_follows_a_driver_that_comes_and_keeps_its_claim_when_it_goes() -> None:
    app = driving()
    assert decide(app, stored(app, claiming=False), ALL)
    assert decide(app, stored(app, claiming=True), NO_DRIVER)


def test_an_edit_and_a_suspension_decide_anew() -> None:
    edited = driving(args=["--fast"])
    before = stored(driving(), claiming=False)
    assert decide(edited, before, ALL, placed=True)
    assert not decide(edited, stored(driving(), claiming=True), NO_DRIVER, placed=True)
    app = driving()
    assert decide(app, stored(app, claiming=False, replicas=0), ALL, placed=True)


def test_a_deployment_of_another_spec_counts_as_edited() -> None:
    app = driving()
    (item,) = stored(app, claiming=True).values()
    assert item.metadata.annotations[Annotation.SPEC_HASH] == app.spec_hashes["driver"]


def test_under_another_scheduler_a_driver_counts_on_nodes_without_labels_of_hardware() -> None:
    app = make_app(component("driver", devices=[LIDAR]), schedulerName="default-scheduler")
    assert decide(app, {}, on("amr-07"))


@pytest.mark.parametrize(
    ("claiming", "drivers", "says"),
    [
        (True, on("amr-07"), "on 1 of 2 nodes that it may run on"),
        (True, NO_DRIVER, "waits for a node with the driver of devices"),
        (True, on("amr-07", "edge-1"), ""),
        (False, on("amr-07"), "began before its node had the driver"),
        (False, NO_DRIVER, ""),
    ],
)
def test_what_a_user_may_not_expect_is_said(claiming: bool, drivers: DriverNodes, says: str) -> None:
    app = driving()
    text = describe_ledger(
        desired_of(app, "amr-07"), stored(app, claiming=claiming), drivers, LABELS, places={"driver": "amr-07"}
    )
    assert says in text
    assert bool(text) is bool(says)


BUS: dict[str, Any] = {"name": "bus", "type": "canbus"}
NETWORK = {"template": {"spec": {"hostNetwork": True}}}


@pytest.mark.parametrize(
    ("device", "fields", "cure"),
    [
        (BUS, {}, "hostNetwork: true"),
        (BUS, NETWORK, ""),
        (LIDAR | {"sharing": "Cluster"}, {}, "leave sharing out"),
        (LIDAR | {"sharing": "Namespace"}, {}, "leave sharing out"),
        (LIDAR, {}, ""),
        ({"name": "gpu", "type": "gpu"}, {}, ""),
    ],
)
def test_what_no_driver_hands_over_is_noted_with_its_cure_where_one_runs(
    device: dict[str, Any], fields: dict[str, Any], cure: str
) -> None:
    app = make_app(component("driver", runsOn=["Robot"], devices=[device], **fields))
    notes = list_handover_notes(app, ["amr-07"], on("amr-07"))
    assert [cure in note for note in notes] == ([True] if cure else [])
    assert list_handover_notes(app, ["amr-07"], on("amr-08")) == ()
    assert list_handover_notes(app, ["amr-07"], NO_DRIVER) == ()
    observed = stored(app, claiming=False)
    text = describe_ledger(desired_of(app, "amr-07"), observed, on("amr-07"), LABELS, places={"driver": "amr-07"})
    assert not cure or cure in text
    assert not describe_ledger(desired_of(app, "amr-07"), observed, NO_DRIVER, LABELS, places={"driver": "amr-07"})
