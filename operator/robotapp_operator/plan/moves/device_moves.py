"""Carries out the rule of `devices[].onLoss`: the pod of a lost device is kept, restarted when the device is back, or moved.

- Keep: nothing.
- Restart: when the device is back, the pod that lost it is evicted. Its successor gets the claim, and so the same device.
- Reschedule: when another node has a free one, the pod is evicted, within the limits that all moves share. Its ResourceClaim, where it
  has one, goes with it: an allocated claim would hold the successor on the node of the lost device.

When so many pods lose a device at once that a mistake of an agent is likelier, none of them is (`mass_loss`).
"""

from collections.abc import Callable, Mapping, Sequence
from datetime import datetime
from typing import Final

from robotapp_api.model.app.component import Component
from robotapp_operator.plan.moves.mass_loss import Losses
from robotapp_operator.plan.moves.rescheduling import Move, Running, Stays, is_tied_to_robot, limits_of
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.plan.status.device_loss import LostDevice

KEEP: Final = "Keep"
RESTART: Final = "Restart"
RESCHEDULE: Final = "Reschedule"


def on_loss_of(component: Component) -> str:
    """The strongest onLoss of its devices: one pod cannot be kept for one device and moved for another."""
    values = {device.on_loss for device in component.devices}
    return RESCHEDULE if RESCHEDULE in values else RESTART if RESTART in values else KEEP


def move_for_device(
    app: App,
    lost: Sequence[LostDevice],
    *,
    running: Mapping[str, Running],
    elsewhere: Callable[[Component], str],
    losses: Callable[[], Losses],
    now: datetime,
) -> Move | Stays | None:
    """What to do about devices that have been lost for a while; None when no component with onLoss Reschedule lost one.

    elsewhere: another usable node with devices of the kinds that the component needs, none of them held; "" without one.
    losses: what other pods have lost; called only when a pod is about to move.
    """
    first: Stays | None = None
    for device in lost:
        component = next((one for one in app.spec.components if one.name == device.component), None)
        pod = running.get(device.component)
        if component is None or pod is None or pod.pod != device.pod or not _may_move(component):
            continue
        found = _of_component(app, component, device, pod, elsewhere=elsewhere, losses=losses, now=now)
        if isinstance(found, Move):
            return found
        first = first or found
    return first


def _may_move(component: Component) -> bool:
    """Of several replicas none is moved, also while only one of them runs."""
    return on_loss_of(component) == RESCHEDULE and component.replicas == 1


def _of_component(
    app: App,
    component: Component,
    device: LostDevice,
    pod: Running,
    *,
    elsewhere: Callable[[Component], str],
    losses: Callable[[], Losses],
    now: datetime,
) -> Move | Stays:
    if is_tied_to_robot(component):
        return Stays(component.name, "it stays on its robot: runsOn is [Robot]")
    node = elsewhere(component)
    if not node:
        return Stays(component.name, "no other node has such a device that is free")
    if pod.record is None:
        return Stays(component.name, "annotation robotics.io/moves of its Deployment cannot be read: remove it")
    if problem := pod.record.why_not(pod.pod, limits_of(app), now):
        return Stays(component.name, problem)
    if problem := losses().why_no_move(pod.node):
        return Stays(component.name, problem)
    return Move(component.name, pod.pod, pod.node, node, f"{device} is lost", pod.record.counts(pod.pod, now))


def restarts(recorded: Mapping[str, str], *, there: Callable[[str], bool]) -> frozenset[str]:
    """Uids of pods to restart: what they lost is back. recorded: claim -> pod. there: is a claim's device there again?

    A pod that lost several devices waits for the last of them.
    """
    waiting = {pod for claim, pod in recorded.items() if not there(claim)}
    return frozenset(recorded.values()) - waiting
