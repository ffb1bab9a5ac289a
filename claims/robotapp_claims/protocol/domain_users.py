"""The users of a domain claim, read from the API server where the listings alone cannot prove them.

In the usual case a live pod answers and nothing is read. Only for a claim without one is its app read, to see whether
the Deployments that name its id belong to an app that exists, and the apps whose specs share it.
"""

from robotapp_claims.protocol.domains import resolve_owner
from robotapp_claims.protocol.sweep_snapshot import View, find
from robotapp_claims.rules.objects import App, Claim
from robotapp_claims.rules.release import is_gone
from robotapp_claims.rules.usage import AppRef, Usage
from robotapp_client.api.resources import ROBOTAPPS


async def used(view: View, claim: Claim) -> bool:
    """Whether the workloads of the view still use a domain claim."""
    return await _used(view, view.usage, claim)


async def used_elsewhere(view: View, claim: Claim) -> bool | None:
    """Whether apps of other namespaces, which share it, use a domain. None: unknown, because we may not read them.

    The sweep calls this only before it gives a claim back. Usage is read after the claim, like everything else.
    """
    if view.everywhere:
        return False
    usage = await view.usage_everywhere()
    return None if usage is None else await _used(view, usage, claim)


async def _used(view: View, usage: Usage, claim: Claim) -> bool:
    if usage.uses(claim, app_exists=False):
        return True
    if usage.uses(claim, app_exists=True) and await view.app(claim.holder) is not None:
        return True
    for sharer in sorted(usage.sharers(claim)):
        if await _shares(view, sharer, claim):
            return True
    return False


async def _shares(view: View, sharer: AppRef, claim: Claim) -> bool:
    """Whether the app exists and may use the claim: of the holder's namespace, or joined to its app by both."""
    app = await existing_app(view, sharer)
    holder = claim.holder
    if app is None:
        return False
    if sharer.namespace == holder.namespace:
        return True
    if await view.app(holder) is None:
        return False
    return (await resolve_owner(view.client, app)).owner == (holder.namespace, holder.name)


async def existing_app(view: View, ref: AppRef) -> App | None:
    """The RobotApp that owner references name, None when there is none of this uid."""
    app = await find(view.client, ROBOTAPPS, ref.name, ref.namespace, App)
    return None if is_gone(app, ref.uid) else app
