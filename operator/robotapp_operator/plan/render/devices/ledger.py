"""Chooses which components get their devices by a ResourceClaim, and which by RobotClaims.

A node that gains or loses the driver must restart nothing. So the choice is made when a component is created, edited, resumed,
or waits for a node with no pod on any; in between it is what the Deployment's template says.
"""

from collections.abc import Collection, Iterable, Mapping
from typing import NamedTuple

from robotapp_api.checks.device_names import handover_notes
from robotapp_api.model.app.component import Component
from robotapp_api.model.names import Annotation, Label
from robotapp_operator.plan.render.child import DEPLOYMENT, JOB
from robotapp_operator.plan.render.devices.resource_claim import may_be_handed_over, named_claim
from robotapp_operator.plan.render.node_affinity import nodes_for
from robotapp_operator.plan.spec.desired import App, Desired, desired_of, is_edited
from robotapp_operator.plan.spec.objects import ChildRef, Deployment, Job


class DriverNodes(NamedTuple):
    """Nodes where the driver runs, and the labels of all nodes by name."""

    names: Collection[str] = frozenset()
    labels: Mapping[str, Mapping[str, str]] = {}


NO_DRIVER = DriverNodes()


def claiming_components(
    desired: Desired, observed: Mapping[ChildRef, object], drivers: DriverNodes, *, placed: Collection[str]
) -> frozenset[str]:
    """Returns the components that get a ResourceClaim. placed: those with a pod on a node."""
    return frozenset(
        component.name
        for component in desired.app.spec.components
        if may_be_handed_over(component) and _takes_claim(component, desired, observed, drivers, placed=placed)
    )


def _takes_claim(
    component: Component,
    desired: Desired,
    observed: Mapping[ChildRef, object],
    drivers: DriverNodes,
    *,
    placed: Collection[str],
) -> bool:
    item = observed.get(ChildRef(DEPLOYMENT, desired.name_of(component.name)))
    if (job := _find_job(component, desired, observed)) is not None:
        return bool(named_claim(job.spec))  # its template cannot be changed
    if isinstance(item, Deployment):
        has_claim = bool(named_claim(item.spec))
        has_other_spec = item.metadata.annotations.get(Annotation.SPEC_HASH) != desired.app.spec_hashes[component.name]
        if not has_other_spec and item.replicas and (has_claim or component.name in placed):
            return has_claim
    return bool(driver_nodes_of(component, desired, drivers))


def _find_job(component: Component, desired: Desired, observed: Mapping[ChildRef, object]) -> Job | None:
    """Returns the Job that is the component's present run, None where another one would be made."""
    if component.schedule is None:
        job = observed.get(ChildRef(JOB, desired.name_of(component.name)))
        if not isinstance(job, Job) or component.job is None or is_edited(desired.app, component.name, job):
            return None
        return job
    jobs = (
        item
        for item in observed.values()
        if isinstance(item, Job) and item.metadata.labels.get(Label.COMPONENT) == component.name
    )
    return next((job for job in jobs if job.verdict is None and Annotation.DUE_AT in job.metadata.annotations), None)


def driver_nodes_of(component: Component, desired: Desired, drivers: DriverNodes) -> frozenset[str]:
    """Returns the nodes with the driver that the component's own requirements admit."""
    labels = {name: drivers.labels[name] for name in drivers.names if name in drivers.labels}
    return nodes_for(component, desired, labels, by_claim=True)


def list_handover_notes(app: App, robots: Iterable[str], drivers: DriverNodes) -> tuple[str, ...]:
    """Returns a sentence for each device that no driver hands over as written, of components that nodes with the driver may run."""
    if not drivers.names:
        return ()
    instances = [desired_of(app, robot) for robot in robots]
    return tuple(
        str(note)
        for index, component in enumerate(app.spec.components)
        if any(driver_nodes_of(component, desired, drivers) for desired in instances)
        for note in handover_notes(component, f"spec.components[{index}]")
    )


def describe_ledger(
    desired: Desired,
    observed: Mapping[ChildRef, object],
    drivers: DriverNodes,
    all_labels: Mapping[str, Mapping[str, str]],
    *,
    places: Mapping[str, str],
) -> str:
    """Returns what a user may not expect of the first component that has it, "" without one. places: components and their nodes.

    Shared devices, and those of a component with a CAN bus in a network of its own, are handed over nowhere. A component with a ResourceClaim runs on nodes with the driver alone. One with RobotClaims gets no device file, also where the
    driver came after its start.
    """
    for component in desired.app.spec.components:
        item = observed.get(ChildRef(DEPLOYMENT, desired.name_of(component.name)))
        if not isinstance(item, Deployment):
            continue
        if places.get(component.name) in drivers.names and (notes := [*handover_notes(component, component.name)]):
            return str(notes[0])
        if not may_be_handed_over(component):
            continue
        if named_claim(item.spec):
            admitted = nodes_for(component, desired, all_labels, by_claim=True)
            having = admitted & frozenset(drivers.names)
            if not having:
                return (
                    f"{component.name} waits for a node with the driver of devices: none that it may run on has it now"
                )
            if having != admitted:
                return f"{component.name} runs where the driver hands devices over: on {len(having)} of {len(admitted)} nodes that it may run on"
        elif places.get(component.name) in drivers.names:
            return f"{component.name} began before its node had the driver: write suspend: true, then false, to have its devices handed over"
    return ""
