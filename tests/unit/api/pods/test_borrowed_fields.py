"""Every field that is borrowed from core is rendered into the pod, refused, or told about: none is stored and lost."""

import json
from collections.abc import Iterator
from typing import Any, Final

import pytest
from tests.support.factories import component, make_app

from robotapp_api.checks.spec import spec_notes, spec_problems
from robotapp_api.model.app.component import Component
from robotapp_api.model.app.template import TemplateSpec
from robotapp_api.model.base import Model
from robotapp_api.model.markers import Core
from robotapp_api.schema import vendor
from robotapp_operator.plan.render.parameters import NONE
from robotapp_operator.plan.render.pod_template import pod_template
from robotapp_operator.plan.spec.desired import Domain, desired_of

Json = dict[str, Any]
FIELDS: Final[Json] = json.loads(vendor.FILE.read_text())["fields"]
OFF: Final = (
    "stopSignal", "bindMountOptions", "grpc.mode", "httpGet.protocol", "emptyDir.mode", "defaultUser", "items[].user",
    "clusterTrustBundle.user", "podCertificate.user", "serviceAccountToken.user",
)  # fmt: skip
"""Fields whose gate is off in the newest supported Kubernetes, whose API server drops them (`dropDisabledFields` and its like)."""


def borrowed(model: type[Model]) -> Iterator[tuple[str, str]]:
    """Field as in YAML, and the name of its vendored schema."""
    for name, field in model.model_fields.items():
        for part in (*field.metadata, *marks(field.annotation)):
            if isinstance(part, Core):
                yield field.alias or name, f"{part.kind}.{part.field}"


def marks(annotation: Any) -> Iterator[Any]:
    """Markers inside a union, such as those of `Annotated[…] | None`."""
    for part in getattr(annotation, "__args__", ()):
        yield from getattr(part, "__metadata__", ())
        yield from marks(part)


def filled(schema: Json, path: str = "") -> Any:
    """A value with every field of the schema, which no API server would take and our code passes on."""
    if "x-kubernetes-int-or-string" in schema:
        return 1
    match schema.get("type"):
        case "object" if "properties" in schema:
            return {key: filled(member, f"{path}.{key}") for key, member in schema["properties"].items()}
        case "object":
            return {"key": filled(schema["additionalProperties"], path)}
        case "array":
            return [filled(schema["items"], f"{path}[]")]
        case "integer":
            return max(1, schema.get("minimum", 1))
        case "boolean":
            return True
    return schema.get("enum", ["x"])[-1]


def leaves(value: Any, path: str) -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict):
        for key, member in value.items():
            yield from leaves(member, f"{path}.{key}" if path else key)
    elif isinstance(value, list):
        for member in value:
            yield from leaves(member, f"{path}[]")
    else:
        yield path, value


CONTAINER = dict(borrowed(Component))
POD = dict(borrowed(TemplateSpec))


def rendered(body: Json) -> tuple[Json, str]:
    """The pod's spec, and all that is said of the app."""
    # One pod, so that the operator gives it no name of its own for peers.
    app = make_app(body)
    said = " ".join(map(str, (*spec_problems(app.spec), *spec_notes(app.spec))))
    return pod_template(app.spec.components[0], desired_of(app, ""), domain=Domain(7), state=NONE)["spec"], said


def lost(written: Any, field: str, holder: Json) -> list[str]:
    stored = dict.fromkeys((path, json.dumps(value)) for path, value in leaves(holder.get(field), field))
    return [path for path, value in leaves(written, field) if (path, json.dumps(value)) not in stored]


def test_the_fields_are_those_of_the_schema() -> None:
    assert {"ports", "lifecycle", "stdin", "tty"} <= CONTAINER.keys()
    assert {"hostNetwork", "hostIPC", "containers", "dnsConfig", "volumes"} <= POD.keys()


@pytest.mark.parametrize("field", sorted(CONTAINER))
def test_a_borrowed_field_of_the_container_reaches_the_pod(field: str) -> None:
    value = filled(FIELDS[CONTAINER[field]])
    pod, _ = rendered(component("driver", **{field: value}))
    assert lost(value, field, pod["containers"][0]) == []


@pytest.mark.parametrize("field", sorted(POD))
def test_a_borrowed_field_of_the_pod_reaches_it(field: str) -> None:
    value = filled(FIELDS[POD[field]])
    pod, _ = rendered(component("driver", template={"spec": {field: value}}))
    assert lost(value, field, pod) == []


def places() -> Iterator[tuple[str, str]]:
    for field, name in CONTAINER.items():
        yield field, name
    for field, name in POD.items():
        yield f"template.spec.{field}", name


@pytest.mark.parametrize(("field", "name"), list(places()), ids=lambda part: part)
def test_a_field_that_the_api_server_would_drop_is_refused_or_told(field: str, name: str) -> None:
    value = filled(FIELDS[name])
    body: Json = component("driver", template={"spec": {field.rpartition(".")[2]: value}})
    if "." not in field:
        body = component("driver", **{field: value})
    _, said = rendered(body)
    dropped = [path for path, _ in leaves(value, field) if path.endswith(OFF) or any(f"{off}[" in path for off in OFF)]
    for path in dropped:
        place = f"spec.components[0].{path}".replace("[]", "[0]")
        assert place.removesuffix("[0]") in said, place
