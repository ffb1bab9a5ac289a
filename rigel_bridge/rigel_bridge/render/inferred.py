"""Fields of a RobotApp that the user left open, filled from the source of the packages; never over what was written."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

from rigel_bridge.document.naming import label
from rigel_bridge.generations.model import Target
from rigel_bridge.names import PROVENANCE
from rigel_bridge.render.app import Rendered

ANNOTATION: Final = f"{PROVENANCE}inferred"
MAX_ANNOTATION: Final = 4000


@dataclass(frozen=True, slots=True)
class Inference:
    """What the source of a package shows: component fields in the API's words, and how sure the class is (0 to 1)."""

    fields: Mapping[str, Any]
    confidence: float = 0.0
    doubts: tuple[str, ...] = ()
    """What may be needed and is not sure enough to keep a pod from a node, such as `gpu (0.41)`."""


def filled(rendered: Rendered, target: Target, inferences: Mapping[str, Inference]) -> tuple[Rendered, tuple[str, ...]]:
    """The app with its open fields filled, and remarks that stand as comments above it.

    A component whose scheduling the file describes, in its own block or in the common one, stays as it is.
    """
    names = {label(package.name): package.name for package in target.packages}
    spec = dict(rendered.app["spec"])
    components: list[dict[str, Any]] = []
    marks: list[str] = []
    remarks: list[str] = []
    for component in spec["components"]:
        package = names.get(component["name"], component["name"])
        inference = inferences.get(package) or inferences.get(package.replace("-", "_"))
        if inference is None:
            remarks.append(f"{component['name']}: no package {package} among the sources: nothing inferred")
        elif _is_described(target, component["name"]):
            remarks.append(f"{component['name']}: has a scheduler block: nothing inferred")
        else:
            component, added = _completed(component, inference)  # noqa: PLW2901 - the completed one takes its place
            marks += [f"{component['name']}.{field}" for field in added]
            remarks += _remarks(component["name"], added, inference)
        components.append(component)
    if not marks:
        return rendered, tuple(remarks)
    spec["components"] = components
    metadata = dict(rendered.app["metadata"])
    metadata["annotations"] = dict(
        sorted({**metadata.get("annotations", {}), ANNOTATION: " ".join(marks)[:MAX_ANNOTATION]}.items())
    )
    return replace(rendered, app={**rendered.app, "metadata": metadata, "spec": spec}), tuple(remarks)


def _is_described(target: Target, name: str) -> bool:
    block = target.orchestration
    if block is None:
        return False
    if block.get("scheduler"):
        return True
    components = block.section("components")
    own = components.node.mapping() if components else {}
    return any(
        label(key) == name and "scheduler" in node.mapping() and node.mapping()["scheduler"].kind != "null"
        for key, node in own.items()
    )


def _completed(component: dict[str, Any], inference: Inference) -> tuple[dict[str, Any], list[str]]:
    added = [field for field in inference.fields if field not in component]
    return {**component, **{field: inference.fields[field] for field in added}}, added


def _remarks(name: str, added: list[str], inference: Inference) -> list[str]:
    found = (
        [f"{name}: {', '.join(added)} inferred from its source (confidence {inference.confidence:.2f})"]
        if added
        else []
    )
    return found + [
        f"{name}: perhaps needs {doubt}: left out, a wrong device keeps the pod pending" for doubt in inference.doubts
    ]
