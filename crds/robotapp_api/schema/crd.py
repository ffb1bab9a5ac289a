"""CustomResourceDefinitions from the models."""

from typing import Any, Final, Protocol

from robotapp_api.model import names
from robotapp_api.model.app.robotapp import RobotApp
from robotapp_api.model.base import Model
from robotapp_api.model.claim import RobotClaim
from robotapp_api.model.instance import RobotAppInstance
from robotapp_api.model.markers import Column, Kind
from robotapp_api.model.pool import DomainPool
from robotapp_api.model.telemetry import NodeTelemetry
from robotapp_api.schema.collect import Schema, collect
from robotapp_api.schema.structural import to_structural

CATEGORY: Final = "robotics"
KINDS: Final[tuple[type[Model], ...]] = (
    DomainPool,
    NodeTelemetry,
    RobotApp,
    RobotAppInstance,
    RobotClaim,
)


class _Root(Protocol):
    CRD: Kind


def info(model: type[Model]) -> Kind:
    """Plural, columns and so on of a root model."""
    root: type[_Root] = model  # type: ignore[assignment]  # every entry of KINDS has CRD; a test says so
    return root.CRD


def schema_of(model: type[Model]) -> Schema:
    """The openAPIV3Schema of a root model."""
    schema = to_structural(collect(model))
    for key in ("apiVersion", "kind"):
        schema["properties"][key] = {"description": schema["properties"][key]["description"], "type": "string"}
    schema["properties"]["metadata"] = {"type": "object"}
    return schema


def definition(model: type[Model]) -> dict[str, Any]:
    """The whole CustomResourceDefinition of a root model."""
    kind = info(model)
    version: dict[str, Any] = {
        "name": names.VERSION,
        "served": True,
        "storage": True,
        "subresources": {"status": {}},
        "additionalPrinterColumns": [_column(column) for column in kind.columns],
        "selectableFields": [{"jsonPath": path} for path in kind.selectable],
        "schema": {"openAPIV3Schema": schema_of(model)},
    }
    if not kind.selectable:
        del version["selectableFields"]
    return {
        "apiVersion": "apiextensions.k8s.io/v1",
        "kind": "CustomResourceDefinition",
        "metadata": {"name": f"{kind.plural}.{names.GROUP}"},
        "spec": {
            "group": names.GROUP,
            "scope": "Namespaced" if kind.namespaced else "Cluster",
            "names": {
                "kind": model.__name__,
                "listKind": f"{model.__name__}List",
                "plural": kind.plural,
                "singular": kind.singular,
                "shortNames": list(kind.short_names),
                "categories": [CATEGORY],
            },
            "versions": [version],
        },
    }


def _column(column: Column) -> dict[str, Any]:
    entry: dict[str, Any] = {"name": column.name, "type": column.type, "jsonPath": column.path}
    return entry | {"priority": 1} if column.wide else entry
