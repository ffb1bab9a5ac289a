"""`shareWith`: apps that use one domain on purpose. One of them holds the claim, the others carry its id."""

from collections.abc import Callable
from dataclasses import dataclass

from robotapp_api.claims.objects import App
from robotapp_api.claims.release import joined

AppKey = tuple[str, str]
"""(namespace, name)."""
Lookup = Callable[[AppKey], App | None]


@dataclass(frozen=True, slots=True)
class Join:
    """owner: the app that claims (possibly the asking app itself), or None with the message why nobody can say."""

    owner: AppKey | None
    message: str = ""


def key_of(app: App) -> AppKey:
    return (app.metadata.namespace, app.metadata.name)


def may_join(app: App, other: App) -> bool:
    """Within a namespace asking is enough; across namespaces the other app must name this one in turn."""
    return app.metadata.namespace == other.metadata.namespace or key_of(app) in joined(other)


def owner_of(app: App, lookup: Lookup) -> Join:
    """Follow shareWith to the app that holds the domain. A ring of apps is led by its first in name order."""
    path: list[AppKey] = []
    current = app
    while True:
        key = key_of(current)
        if key in path:
            return Join(min(path[path.index(key) :]))
        path.append(key)
        asked = joined(current)
        if not asked:
            return Join(key)
        if len(asked) > 1 and not _agree(current, lookup):
            names = ", ".join("/".join(other) for other in asked)
            return Join(None, f"the apps in shareWith of {'/'.join(key)} ({names}) do not share one domain")
        target = lookup(asked[0])
        if target is None:
            return Join(None, f"shareWith names {'/'.join(asked[0])}, which does not exist: create it or remove it")
        if not may_join(current, target):
            here, there = "/".join(key), "/".join(asked[0])
            return Join(None, f"{there} is in another namespace: it must name {here} in its own dds.shareWith")
        current = target


def _agree(app: App, lookup: Lookup) -> bool:
    """Whether all entries lead to one owner: those that name this app in turn follow whatever it decides."""
    owners = set()
    for key in joined(app):
        other = lookup(key)
        if other is None or key_of(app) in joined(other):
            continue
        owners.add(owner_of(other, lookup).owner)
    return len(owners) <= 1


def sharer_instance(instance: str, owner_instances: tuple[str, ...]) -> str | None:
    """Which of the owner's instances an instance joins: the same robot's, else the only one."""
    if instance in owner_instances:
        return instance
    return owner_instances[0] if len(owner_instances) == 1 else None
