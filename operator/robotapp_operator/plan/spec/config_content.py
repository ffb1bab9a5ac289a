"""Contents of a component's ConfigMaps and Secrets as hashes: those it was started with are compared with those of now.

ConfigMaps are read by content. A Secret is never read: where the operator may watch its metadata, its version stands for it.
"""

import dataclasses
import hashlib
from collections.abc import Iterable, Mapping
from typing import Final, NamedTuple

from robotapp_api.model.app.component import Component
from robotapp_api.values.component_references import list_further_containers, list_object_references
from robotapp_api.values.overrides import apply_overrides
from robotapp_api.values.references import ObjectReference, Values, expand, reference_values
from robotapp_operator.plan.spec.covers import content_hash
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.plan.spec.objects import ConfigMap

CONFIG_MAP: Final = "ConfigMap"
SECRET: Final = "Secret"  # noqa: S105 - a kind
OF_THE_SYSTEM: Final = frozenset({"kube-root-ca.crt", "openshift-service-ca.crt"})
"""ConfigMaps that the cluster writes into every namespace: a new certificate there is no reason to restart robots."""
_DIGITS: Final = 16


class ClusterConfig(NamedTuple):
    """The ConfigMaps and Secrets of a cluster as far as they are read, by `namespace/name`.

    `secrets` has an entry for each namespace in which Secrets may be watched: their versions.
    """

    config_maps: Mapping[str, ConfigMap]
    secrets: Mapping[str, Mapping[str, str]]


@dataclasses.dataclass(frozen=True, slots=True)
class ConfigContent:
    """Hashes of what a component reads.

    `mounted`: of what volumes and environment read, by kind and name such as `ConfigMap drv`. `files`: of what the
    parameter files read. `references`: hash of what the component refers to. `missing`: sentences about required objects and keys
    that do not exist.
    """

    mounted: Mapping[str, str] = dataclasses.field(default_factory=dict)
    files: Mapping[str, str] = dataclasses.field(default_factory=dict)
    references: str = ""
    missing: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        """Decides whether the component reads any ConfigMap, or a Secret whose version is known."""
        return bool(self.mounted or self.files)

    @property
    def mounted_hash(self) -> str:
        """Returns one hash over all that is mounted or read as environment."""
        lines = [f"{name}={digest}\n" for name, digest in sorted(self.mounted.items())]
        return hashlib.sha256("".join(lines).encode()).hexdigest()[:_DIGITS]

    def with_unfollowed(self, mounted: Mapping[str, str], files: Mapping[str, str]) -> "ConfigContent":
        """Returns the content with the recorded hashes of Secrets whose versions are not known now.

        So it is for a moment after each start of the operator: what is not seen has not changed.
        """

        def join(digests: Mapping[str, str], recorded: Mapping[str, str]) -> dict[str, str]:
            return {name: text for name, text in recorded.items() if name.startswith(f"{SECRET} ")} | {**digests}

        return dataclasses.replace(self, mounted=join(self.mounted, mounted), files=join(self.files, files))

    def changed_since(self, mounted: Mapping[str, str], files: Mapping[str, str]) -> list[str]:
        """Returns the names of the objects that have another content than then."""
        names = {*self.mounted, *self.files, *mounted, *files}
        return sorted(
            name
            for name in names
            if (self.mounted.get(name), self.files.get(name)) != (mounted.get(name), files.get(name))
        )


def list_config_maps(app: App, robot: str) -> frozenset[str]:
    """Returns `namespace/name` of every ConfigMap that the app names for this robot, those of the system left out."""
    return frozenset(
        f"{app.namespace}/{reference.name}"
        for component in app.spec.components
        for reference in _references(component, app.reference_values(component.name, robot))
        if reference.kind == CONFIG_MAP and reference.name not in OF_THE_SYSTEM
    )


def list_secrets(app: App, robot: str) -> frozenset[str]:
    """Returns the names of the Secrets whose content the app's containers read."""
    return frozenset(
        reference.name
        for component in app.spec.components
        for reference in _references(component, app.reference_values(component.name, robot))
        if reference.kind == SECRET
    )


def reads_config(app: App) -> bool:
    """Decides whether any component names a ConfigMap or Secret, with its overrides or without."""
    every = {
        component.name: tuple(
            item.name for item in app.spec.overrides if any(part.name == component.name for part in item.components)
        )
        for component in app.spec.components
    }
    specs = (app.spec, apply_overrides(app.spec, every))
    return any(_references(component, reference_values("")) for spec in specs for component in spec.components)


def names_secrets(app: App) -> bool:
    """Decides whether the app names any Secret whose content its containers read."""
    return bool(list_secrets(app, ""))


def config_content(component: Component, app: App, robot: str, cluster_config: ClusterConfig) -> ConfigContent:
    """Returns the hashes of what the component reads. Secrets count where their versions are known."""
    sentences: list[str] = []
    values = app.reference_values(component.name, robot)
    references = _mounted(component, values), _files(component, values)
    unneeded = _list_unmounted(component)
    digests, file_digests = (_read(group, app.namespace, cluster_config, sentences, unneeded) for group in references)
    return ConfigContent(digests, file_digests, content_hash(references), tuple(dict.fromkeys(sentences)))


def _references(component: Component, values: Values) -> Iterable[ObjectReference]:
    return (*_mounted(component, values), *_files(component, values))


def _mounted(component: Component, values: Values) -> list[ObjectReference]:
    return [
        reference._replace(
            name=expand(reference.name, values), keys=tuple(expand(key, values) for key in reference.keys)
        )
        for reference in list_object_references(component, "")
    ]


def _list_unmounted(component: Component) -> tuple[str, ...]:
    """Returns where the volumes stand that no container mounts. The kubelet leaves them out, so a pod starts without their objects."""
    further = (container.get("volumeMounts") or () for container, _ in list_further_containers(component, ""))
    mounted = {str(mount.get("name")) for mounts in (component.volume_mounts, *further) for mount in mounts}
    volumes = component.template.spec.volumes
    return tuple(
        f".template.spec.volumes[{index}]." for index, volume in enumerate(volumes) if volume.get("name") not in mounted
    )


def _files(component: Component, values: Values) -> list[ObjectReference]:
    file_references = []
    for file in component.parameters:
        if file.config_map_key_ref:
            ref = file.config_map_key_ref
            file_references.append(
                ObjectReference(CONFIG_MAP, expand(ref.name, values), (expand(ref.key, values),), ref.optional)
            )
        elif file.secret_key_ref:
            file_references.append(
                ObjectReference(
                    SECRET, expand(file.secret_key_ref.name, values), (expand(file.secret_key_ref.key, values),)
                )
            )
    return file_references


def _read(
    references: Iterable[ObjectReference],
    namespace: str,
    cluster_config: ClusterConfig,
    sentences: list[str],
    unneeded: tuple[str, ...],
) -> dict[str, str]:
    """Returns the hashes by kind and name, and appends a sentence for each object that a pod lacks. unneeded: where those stand that it
    starts without.
    """
    parts: dict[str, list[str]] = {}
    for reference in references:
        text: str | None = None
        missing = [] if reference.path.startswith(unneeded) else sentences
        if reference.kind == CONFIG_MAP and reference.name not in OF_THE_SYSTEM:
            text = _read_config_map(reference, cluster_config.config_maps.get(f"{namespace}/{reference.name}"), missing)
        elif reference.kind == SECRET and namespace in cluster_config.secrets:
            text = cluster_config.secrets[namespace].get(reference.name, "")
            if not text and not reference.optional:
                missing.append(f"there is no Secret {reference.name}")
        if text is not None:
            parts.setdefault(f"{reference.kind} {reference.name}", []).append(text)
    return {
        name: hashlib.sha256("\0".join(texts).encode()).hexdigest()[:_DIGITS] for name, texts in sorted(parts.items())
    }


def _read_config_map(reference: ObjectReference, config_map: ConfigMap | None, missing: list[str]) -> str:
    """Returns the keys that are read with their hashes, and appends what is missing of them."""
    if config_map is None:
        if not reference.optional:
            missing.append(f"there is no ConfigMap {reference.name}")
        return ""
    if not reference.keys:
        return "".join(f"{key}={digest}\n" for key, digest in sorted(config_map.data.items()))
    absent = [key for key in reference.keys if key not in config_map.data]
    if absent and not reference.optional:
        missing.append(f"ConfigMap {reference.name} has no key {absent[0]}")
    return "".join(f"{key}={config_map.data.get(key, '')}\n" for key in sorted(reference.keys))
