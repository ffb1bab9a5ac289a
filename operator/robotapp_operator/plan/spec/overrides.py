"""The app as its overrides make it for one robot."""

import dataclasses
from collections.abc import Iterable, Mapping

from robotapp_api.model.names import Annotation, Label
from robotapp_api.values.overrides import OverrideNames, apply_overrides
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.plan.spec.objects import Deployment


def overridden(app: App, names: OverrideNames) -> App:
    """Returns the app with these overrides; it keeps their names, which are written on its Deployments."""
    if not names:
        return app
    return dataclasses.replace(app, spec=apply_overrides(app.spec, names), overrides=names)


def recorded_overrides(deployments: Iterable[Deployment]) -> Mapping[str, tuple[str, ...]]:
    """Returns the overrides that the Deployments of an instance were rendered with, for a robot whose node is out of sight."""
    names: dict[str, tuple[str, ...]] = {}
    for item in deployments:
        component = item.metadata.labels.get(Label.COMPONENT, "")
        text = item.metadata.annotations.get(Annotation.OVERRIDES, "")
        if component and text:
            names[component] = tuple(text.split(","))
    return names
