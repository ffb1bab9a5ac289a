"""`shareWith`: apps that use one domain on purpose. One of them holds the claim, the others carry its id."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

from robotapp_claims.rules.objects import App, Claim
from robotapp_claims.rules.release import joined, wanted_claim

AppKey = tuple[str, str]
"""(namespace, name)."""
Lookup = Callable[[AppKey], App | None]


@dataclass(frozen=True, slots=True)
class Join:
    """owner: the app that claims (possibly the asking app itself), or None with the reason why it is unknown."""

    owner: AppKey | None
    message: str = ""


def key_of(app: App) -> AppKey:
    return (app.metadata.namespace, app.metadata.name)


def may_join(app: App, other: App) -> bool:
    """Within a namespace asking is enough; across namespaces the other app must name this one in turn."""
    return app.metadata.namespace == other.metadata.namespace or key_of(app) in joined(other)


def owner_of(app: App, lookup: Lookup) -> Join:
    """Follow shareWith to where it ends. A ring of apps is led by its first in name order; two ends are an error.

    Every app on the way gets the same answer, because it can only end where this one ends.
    """
    known: dict[AppKey, tuple[AppKey, ...]] = {}
    todo = [app]
    while todo:
        current = todo.pop()
        known[key_of(current)] = joined(current)
        for key in joined(current):
            other = lookup(key)
            problem = _problem(current, key, other, asking=app.metadata.namespace)
            if problem or other is None:
                return Join(None, problem)
            if key not in known:
                todo.append(other)
    ends = {ring for key in known if (ring := _ring(key, known))}
    if len(ends) > 1:
        names = ", ".join(sorted("/".join(min(ring)) for ring in ends))
        return Join(None, f"shareWith of {'/'.join(key_of(app))} leads to apps with different domains: {names}")
    return Join(min(next(iter(ends))))


def _problem(app: App, key: AppKey, other: App | None, *, asking: str) -> str:
    """Why `app` cannot join `key`. What exists in another namespace than the asking app's is not told: absent and not allowed read alike."""
    here, there = "/".join(key_of(app)), "/".join(key)
    if other is not None and may_join(app, other):
        return ""
    if key[0] == asking:
        return f"shareWith of {here} names {there}, which does not exist: create it or remove it"
    return (
        f"shareWith of {here} names {there}, and there is no such app that names {here} in its own spec.ros2.shareWith: both must "
        "name each other across namespaces"
    )


def _ring(key: AppKey, requests: Mapping[AppKey, tuple[AppKey, ...]]) -> frozenset[AppKey]:
    """The apps that follow each other in a ring without an end, `key` among them; empty when `key` is on the way."""
    reached = _reached(key, requests)
    return reached if all(key in _reached(other, requests) for other in reached) else frozenset()


def _reached(key: AppKey, requests: Mapping[AppKey, tuple[AppKey, ...]]) -> frozenset[AppKey]:
    found, todo = {key}, [key]
    while todo:
        new = set(requests[todo.pop()]) - found
        found |= new
        todo += new
    return frozenset(found)


def sharer_instance(instance: str, owner_instances: tuple[str, ...]) -> str | None:
    """Which of the owner's instances an instance joins: the same robot's, else the only one."""
    if instance in owner_instances:
        return instance
    return owner_instances[0] if len(owner_instances) == 1 else None


def claim_to_join(
    owner: App, instance: str, claims: Collection[Claim], *, named: Mapping[str, Collection[int]]
) -> Claim | None:
    """The owner's claim whose id a sharer's instance carries: the one the owner itself wants (rule 4).

    claims: all claims of the owner. named: per instance of the owner that has Deployments, the ids they name; an instance
    without Deployments is on its way out when another one has some. A claim that does not stand is an answer to wait for: the owner
    will take it back, or want another.
    """
    domains = [claim for claim in claims if claim.spec.domain is not None]
    everywhere = {claim.holder.instance for claim in domains}
    standing = {claim.holder.instance for claim in domains if claim.standing} or everywhere
    chosen = sharer_instance(instance, tuple(sorted(standing & set(named) or standing)))
    if chosen is None:
        return None
    return wanted_claim(owner, [c for c in domains if c.holder.instance == chosen], named=named.get(chosen, ()))


def waiting_text(owner: str, instance: str, instances: Collection[str]) -> str:
    """Why a sharer's instance has no domain yet. instances: those of the owner that have claims."""
    if len(instances) < 2 or instance in instances:
        return f"waits for the domain of {owner}, which spec.ros2.shareWith names"
    mine = f"none for {instance}" if instance else "this app is for none of them"
    return f"{owner}, which spec.ros2.shareWith names, has a domain per robot and {mine}: choose the same robots in spec.robots"
