"""What a pod that is being resized in place holds by the formula of kube-scheduler 1.35: the most per container, then the sum.

Since then each of the three sides (requested, granted, in force) is summed over the pod first. The two differ when one
container grows while another shrinks.
"""

from collections.abc import Sequence

import msgspec

from robotapp_api.values.quantities.requests import amount
from robotapp_scheduler.core.api.core_v1 import Container, ContainerStatus, Pod, PodStatus, Resources


def held_per_container(pod: Pod) -> Pod:
    """A pod that holds by its spec what this one holds by that formula; itself when it is not being resized.

    Raises ValueError when a quantity cannot be read.
    """
    status = pod.status
    if not status.resizes:
        return pod
    statuses = {each.name: each for each in reversed(status.container_statuses)}
    spec = msgspec.structs.replace(
        pod.spec,
        containers=[_held(each, statuses, status) for each in pod.spec.containers],
        init_containers=[
            _held(each, statuses, status) if each.restart_policy == "Always" else each
            for each in pod.spec.init_containers or ()
        ],
    )
    plain = msgspec.structs.replace(status, container_statuses=(), allocated_resources=None, resources=None)
    return msgspec.structs.replace(pod, spec=spec, status=plain)


def _held(container: Container, statuses: dict[str, ContainerStatus], status: PodStatus) -> Container:
    reported = statuses.get(container.name)
    if reported is None or reported.resources is None:
        return container
    sides = [reported.resources.requests or {}, reported.allocated_resources or {}]
    if not status.resize_infeasible:
        sides.append(container.resources.requests or {})
    held = msgspec.structs.replace(container.resources, requests=_most(sides))
    return msgspec.structs.replace(container, resources=held)


def _most(sides: Sequence[Resources]) -> Resources:
    found: Resources = {}
    for side in sides:
        for name, value in side.items():
            if name not in found or amount(name, value) > amount(name, found[name]):
                found[name] = value
    return found
