"""Who stands in the way of an instance's devices, for the condition `Allocated`. The scheduler decides; this only tells."""

from collections.abc import Iterable, Mapping

from robotapp_api.claims.device import busy_text, fits
from robotapp_api.claims.identity import claim_name_device
from robotapp_api.claims.instances import Instance
from robotapp_api.claims.objects import Claim
from robotapp_operator.plan.objects import Telemetry
from robotapp_operator.plan.wish import App


def device_trouble(
    app: App,
    instance: Instance,
    *,
    claims: Iterable[Claim],
    telemetry: Mapping[str, Telemetry],
) -> str:
    """The first device the instance asks for of which every one it could take is held by others; "" if there is none.

    An instance with a robot can only take devices of that robot's node, others those of any node.
    """
    held = {claim.name: claim for claim in claims if claim.spec.device is not None}
    mine = {name for name, claim in held.items() if _belongs(claim, app, instance)}
    nodes = [instance.node] if instance.node else sorted(telemetry)
    wishes = (wish for component in app.spec.components for wish in component.devices if wish.exclusive)
    for wish in wishes:
        fitting = [
            claim_name_device(node, device.id)
            for node in nodes
            if node in telemetry
            for device in telemetry[node].status.devices
            if fits(wish, device)
        ]
        if fitting and all(name in held and name not in mine for name in fitting):
            return busy_text(held[fitting[0]], for_namespace=app.namespace)
    return ""


def _belongs(claim: Claim, app: App, instance: Instance) -> bool:
    return claim.holder.uid == app.uid and claim.holder.instance == instance.robot
