"""ROS parameter files of a component: one projected volume, and an argument per file in the order in which they are written.

Inline files travel in annotations of the pod and arrive by the downward API: they change together with the template, and
the operator needs no right to write ConfigMaps. Secrets are mounted and never read.
"""

import dataclasses
import hashlib
from collections.abc import Mapping
from typing import Any, Final

from robotapp_api.model.app.component import Component
from robotapp_api.model.app.parameters import ConfigMapKey, Parameters
from robotapp_api.model.names import PARAMETERS_PATH, PARAMETERS_PREFIX, PARAMETERS_VOLUME, Annotation
from robotapp_api.values.references import Values, expand
from robotapp_operator.plan.spec.desired import App, Desired
from robotapp_operator.plan.spec.objects import ConfigMap


@dataclasses.dataclass(frozen=True, slots=True)
class ParameterState:
    """What a component's files depend on besides the spec: `absent` are positions of optional files that do not exist,
    `hash` is over the content of the ConfigMap keys ("" without any). What is missing of required ones is in `ConfigContent`.
    `config_hash` is over other ConfigMaps and Secrets ("" until a change of them has started the pods anew), `record` what is
    recorded of all that on the Deployment, `change` why the pods start anew now.
    """

    absent: frozenset[int] = frozenset()
    hash: str = ""
    config_hash: str = ""
    record: str = ""
    change: str = ""


NONE: Final = ParameterState()


def parameter_states(app: App, robot: str, config_maps: Mapping[str, ConfigMap]) -> dict[str, ParameterState]:
    """Per component with parameters. config_maps: by `namespace/name`; those that do not exist are left out."""
    return {
        component.name: _state(component, app, robot, config_maps)
        for component in app.spec.components
        if component.parameters
    }


def _state(component: Component, app: App, robot: str, config_maps: Mapping[str, ConfigMap]) -> ParameterState:
    absent: set[int] = set()
    digest = hashlib.sha256()
    read = False
    values = app.reference_values(component.name, robot)
    for position, file in enumerate(component.parameters):
        ref = file.config_map_key_ref
        if ref is None:
            continue
        read = True
        config_map = config_maps.get(f"{app.namespace}/{expand(ref.name, values)}")
        content = config_map.data.get(expand(ref.key, values)) if config_map else None
        if content is None and ref.optional:
            absent.add(position)
        digest.update(f"{position}:{content is None}:".encode() + (content or "").encode() + b"\0")
    return ParameterState(frozenset(absent), digest.hexdigest()[:16] if read else "")


def parameter_paths(component: Component, state: ParameterState) -> list[str]:
    """The files in the container, in the order in which they are passed."""
    present = (position for position in range(len(component.parameters)) if position not in state.absent)
    return [f"{PARAMETERS_PATH}/{_name(position)}" for position in present]


def parameter_annotations(component: Component, desired: Desired, state: ParameterState) -> dict[str, str]:
    """The inline files, and the hashes that roll the pod when a ConfigMap or Secret changes."""
    inline = {
        _annotation(position): expand(file.inline, desired.matrix_variables)
        for position, file in enumerate(component.parameters)
        if file.inline is not None
    }
    hashes = {Annotation.PARAMETERS_HASH.value: state.hash, Annotation.CONFIG_HASH.value: state.config_hash}
    return inline | {name: digest for name, digest in hashes.items() if digest}


def parameter_volume(component: Component, desired: Desired, state: ParameterState) -> list[dict[str, Any]]:
    """One volume with all files, none when there are none."""
    sources = [
        _source(file, position, desired.values_of(component.name))
        for position, file in enumerate(component.parameters)
        if position not in state.absent
    ]
    return [{"name": PARAMETERS_VOLUME, "projected": {"sources": sources}}] if sources else []


def parameter_mount(component: Component, state: ParameterState) -> list[dict[str, Any]]:
    if not parameter_paths(component, state):
        return []
    return [{"name": PARAMETERS_VOLUME, "mountPath": PARAMETERS_PATH, "readOnly": True}]


def _source(file: Parameters, position: int, values: Values) -> dict[str, Any]:
    path = _name(position)
    if file.inline is not None:
        field = f"metadata.annotations['{_annotation(position)}']"
        return {"downwardAPI": {"items": [{"path": path, "fieldRef": {"fieldPath": field}}]}}
    ref = file.config_map_key_ref or file.secret_key_ref
    if ref is None:  # refused by the schema; a file that is nothing mounts nothing
        return {"downwardAPI": {"items": []}}
    kind = "configMap" if isinstance(ref, ConfigMapKey) else "secret"
    return {kind: {"name": expand(ref.name, values), "items": [{"key": expand(ref.key, values), "path": path}]}}


def _name(position: int) -> str:
    return f"{position}.yaml"


def _annotation(position: int) -> str:
    return f"{PARAMETERS_PREFIX}{position}"
