"""RobotAppInstance as the operator reads and writes it: one object per instance of an app.

Deployments, pods and claims belong to the RobotApp, so this object can be deleted at any time and comes back. Then restarts
of its jobs are counted by the Jobs that are there (`plan.diff.attempts`).
"""

from typing import Any

import msgspec

from robotapp_api.model.names import Label
from robotapp_api.values.naming import child_name
from robotapp_operator.plan.render.child import owner_reference
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.plan.spec.objects import Meta, version_number


class AppInstanceSpec(msgspec.Struct, rename="camel", kw_only=True, frozen=True):
    app: str = ""
    app_uid: str = msgspec.field(default="", name="appUID")
    instance: str = ""
    robot: str = ""
    matrix: dict[str, str] = {}


class AppInstance(msgspec.Struct, rename="camel", kw_only=True):
    """A RobotAppInstance; its status as plain JSON, because it is only compared."""

    metadata: Meta
    spec: AppInstanceSpec = AppInstanceSpec()
    status: dict[str, Any] = {}

    @property
    def version_number(self) -> int:
        return version_number(self.metadata.resource_version)


def object_name(app: str, instance: str) -> str:
    """Name of the object of one instance. No other child has it: a child that is part of an instance has a part in its hash."""
    return child_name(app, instance)


def wanted_object(app: App, instance: str) -> dict[str, Any]:
    """The object to create. blockOwnerDeletion is false, so that a foreground deletion of the app does not wait for it."""
    owner = owner_reference(app) | {"blockOwnerDeletion": False}
    return {
        "metadata": {
            "name": object_name(app.name, instance),
            "namespace": app.namespace,
            "labels": _labels(app, instance),
            "ownerReferences": [owner],
        },
        "spec": {key: value for key, value in msgspec.to_builtins(_spec(app, instance)).items() if value != {}},
    }


def is_as_wanted(item: AppInstance, app: App, instance: str) -> bool:
    """Is this the object of the app's instance, with its owner and the labels people look for?"""
    meta = item.metadata
    return (
        item.spec == _spec(app, instance)
        and (meta.namespace, meta.name) == (app.namespace, object_name(app.name, instance))
        and meta.controller_uid == app.uid
        and _labels(app, instance).items() <= meta.labels.items()
    )


def _spec(app: App, instance: str) -> AppInstanceSpec:
    if app.spec.matrix is not None:
        values = app.sweep[instance].values if instance in app.sweep else {}
        return AppInstanceSpec(app=app.name, app_uid=app.uid, instance=instance, matrix=dict(values))
    return AppInstanceSpec(app=app.name, app_uid=app.uid, instance=instance, robot=instance)


def _labels(app: App, instance: str) -> dict[str, str]:
    return {Label.APP.value: app.name, Label.APP_UID.value: app.uid, Label.INSTANCE.value: instance}
