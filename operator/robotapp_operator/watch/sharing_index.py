"""An index of the apps that share a domain by their specs (shareWith): when one changes, the others are reconciled."""

from collections.abc import MutableMapping
from typing import Any

from robotapp_api.model.distros import NO_DISTRO, NO_ROS
from robotapp_claims.rules.objects import App as ClaimsApp
from robotapp_claims.rules.objects import AppSpec, Meta, Ros, Ros2, SharedApp
from robotapp_claims.rules.share import AppKey
from robotapp_operator.plan.spec.desired import App


class SharingIndex:
    """Apps by namespace and name, and the apps that name them in shareWith. An app and its successor of one name may both be here."""

    def __init__(self) -> None:
        self._apps: dict[AppKey, dict[str, App]] = {}
        self._naming: dict[AppKey, dict[str, AppKey]] = {}
        """Per app that shareWith names, existing or not: uid -> key of the apps that name it."""

    def __repr__(self) -> str:
        return f"<Sharing: {len(self._naming)} of {len(self._apps)} apps are named by others>"

    def put(self, app: App, *, before: App | None) -> None:
        """Add an app, or replace its entries of `before`."""
        if before is not None:
            self.drop(before)
        key = (app.namespace, app.name)
        self._apps.setdefault(key, {})[app.uid] = app
        for other in app.share_with:
            self._naming.setdefault(other, {})[app.uid] = key

    def drop(self, app: App) -> None:
        _pop(self._apps, (app.namespace, app.name), app.uid)
        for other in app.share_with:
            _pop(self._naming, other, app.uid)

    def named(self, key: AppKey) -> App | None:
        """The newest app of this name."""
        found = self._apps.get(key)
        return found[next(reversed(found))] if found else None

    def followers(self, key: AppKey) -> set[str]:
        """Uids of the apps whose domain may depend on this app, because shareWith leads them there, step by step."""
        seen, todo, uids = {key}, [key], set[str]()
        while todo:
            naming = self._naming.get(todo.pop(), {})
            uids |= set(naming)
            new = set(naming.values()) - seen
            seen |= new
            todo += new
        return uids


def _pop(table: MutableMapping[AppKey, Any], key: AppKey, uid: str) -> None:
    found = table.get(key, {})
    found.pop(uid, None)
    if not found:
        table.pop(key, None)


def rules_view(app: App) -> ClaimsApp:
    """The app in the form that the claim rules read, with the fields that concern domains."""
    spec = app.spec.ros2
    ros2 = None
    if spec is not None:
        shares = tuple(SharedApp(namespace=namespace, name=name) for namespace, name in app.share_with)
        ros2 = Ros2(
            domain=spec.domain,
            allow_unsafe_domain=spec.allow_unsafe_domain,
            pool=spec.pool,
            isolation=spec.isolation,
            share_with=shares,
        )
    ros = Ros(version=app.spec.ros.version, distro=app.distro if app.ros_version != NO_ROS else NO_DISTRO)
    return ClaimsApp(
        metadata=Meta(name=app.name, namespace=app.namespace, uid=app.uid), spec=AppSpec(ros2=ros2, ros=ros)
    )
