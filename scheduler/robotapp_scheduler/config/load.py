"""Reads a `KubeSchedulerConfiguration` file into plain, frozen values, or lists everything that is wrong with it.

The result is what the process runs with and what `/configz` shows. Without a file the built-in configuration serves
two profiles with the same plugins: `ros-aware-scheduler` and `kubernetes-scheduler` (the name the thesis' files use).
"""

import copy
import hashlib
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import yaml
from pydantic import ValidationError

from robotapp_api.model.names import OUR_SCHEDULERS, SCHEDULER_NAME
from robotapp_api.values import strict_yaml
from robotapp_scheduler.config import validation
from robotapp_scheduler.config.model import (
    API_VERSION,
    KIND,
    ConfigurationModel,
    LeaderElectionModel,
    ProfileModel,
)
from robotapp_scheduler.config.model import PluginSet as PluginSetModel
from robotapp_scheduler.config.plugin_names import IGNORED_ARGUMENTS, with_third_party
from robotapp_scheduler.core.framework.profiles import (
    PLACES,
    Catalogue,
    PluginRef,
    PluginSet,
    Profile,
    ProfileError,
    ProfileSpec,
    build_profiles,
)
from robotapp_scheduler.plugins.kubernetes.common.arguments import OLD

KUBE_SCHEDULERS_LEASE = ("kube-system", "kube-scheduler")
MOST_WHOLE = 1e21
"""From here on Go writes numbers in JSON with an exponent, which no integer field takes."""
MOST_TEXT = 1 << 20
"""What a ConfigMap may hold."""


class ConfigError(ValueError):
    """The configuration cannot be used. `problems` holds one text per mistake, each naming its path."""

    def __init__(self, problems: Sequence[str]) -> None:
        self.problems = tuple(problems)
        super().__init__(problems[0] if len(problems) == 1 else "[" + ", ".join(problems) + "]")


@dataclass(frozen=True, slots=True)
class LeaderElection:
    enabled: bool
    name: str
    namespace: str
    lease_s: float
    renew_s: float
    retry_s: float


@dataclass(frozen=True, slots=True)
class SchedulerConfig:
    """Everything the process needs from the file. Equal files give equal `digest`s."""

    profiles: tuple[ProfileSpec, ...]
    catalogue: Catalogue = field(repr=False, compare=False)
    """All plugin classes the profiles name, third-party ones included."""
    leader_election: LeaderElection
    initial_backoff_s: float = 1.0
    max_backoff_s: float = 10.0
    compat_version: str = "1.37"
    kubeconfig: str = ""
    third_party: tuple[str, ...] = field(default=(), compare=False)
    """Names of plugins in `catalogue` that are not built in."""
    warnings: tuple[str, ...] = field(default=(), compare=False)

    @property
    def scheduler_names(self) -> tuple[str, ...]:
        return tuple(profile.scheduler_name for profile in self.profiles)

    @property
    def sums_per_container(self) -> bool:
        """Do pods that are being resized hold the most per container, as until 1.35?"""
        return self.compat_version == OLD

    def restart_needed(self, other: "SchedulerConfig") -> tuple[str, ...]:
        """Fields in which the other configuration differs that cannot be exchanged while the process runs."""
        pairs = {
            "profiles[].schedulerName": (sorted(self.scheduler_names), sorted(other.scheduler_names)),
            "leaderElection": (self.leader_election, other.leader_election),
            "clientConnection.kubeconfig": (self.kubeconfig, other.kubeconfig),
        }
        return tuple(path for path, (old, new) in pairs.items() if old != new)

    def build(self) -> dict[str, Profile]:
        """Fresh plugin instances for every profile, by schedulerName."""
        return build_profiles(self.profiles, self.catalogue)

    @property
    def digest(self) -> str:
        """Twelve hex digits that name this configuration in logs and explanations."""
        parts = [self.profiles, self.initial_backoff_s, self.max_backoff_s, self.compat_version]
        return hashlib.sha256(msgspec.json.encode(parts, order="deterministic")).hexdigest()[:12]


def load(path: Path | None, *, catalogue: Catalogue) -> SchedulerConfig:
    """The configuration of a file, or the built-in one without a file.

    Raises `ConfigError` with every problem found; nothing of a faulty file is used.
    """
    if path is None:
        return built_in(catalogue)
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise ConfigError([f"{path}: {error.strerror}"]) from error
    except UnicodeDecodeError as error:
        raise ConfigError([f"strict decoding error: yaml: {error}"]) from error
    return parse_text(text, catalogue=catalogue)


def parse_text(text: str, *, catalogue: Catalogue) -> SchedulerConfig:
    """The configuration a file or a ConfigMap holds; see `load`."""
    if len(text) > MOST_TEXT:
        raise ConfigError([f"strict decoding error: {len(text)} characters; at most {MOST_TEXT} are read"])
    try:
        document = strict_yaml.loads(text)
    except yaml.YAMLError as error:
        raise ConfigError([f"strict decoding error: yaml: {error}"]) from error
    return parse(document, catalogue=catalogue)


def built_in(catalogue: Catalogue) -> SchedulerConfig:
    """Both scheduler names with all default plugins."""
    document = {
        "apiVersion": API_VERSION,
        "kind": KIND,
        "profiles": [{"schedulerName": name} for name in OUR_SCHEDULERS],
    }
    return parse(document, catalogue=catalogue)


def parse(document: object, *, catalogue: Catalogue, third_party: Collection[str] | None = None) -> SchedulerConfig:
    """A decoded document to a configuration; see `load`. `third_party` limits which plugins may be imported."""
    model, unknown_fields = _model(_as_decoded(document))
    problems = unknown_fields + validation.check(model)
    profiles = model.profiles or [ProfileModel()]
    built_in_names = frozenset(catalogue.classes)
    catalogue, unknown = with_third_party(catalogue, _plugin_names(profiles), allowed=third_party)
    problems += _name_problems(profiles, unknown)
    problems += validation.argument_kinds(model.profiles, built_in_names)
    specs = tuple(_spec(profile, catalogue, model.compat_version) for profile in profiles)
    if not problems:
        try:
            build_profiles(specs, catalogue)
        except ProfileError as error:
            problems += error.problems
    if problems:
        raise ConfigError(problems)
    return SchedulerConfig(
        profiles=specs,
        catalogue=catalogue,
        leader_election=_leader_election(model.leader_election),
        initial_backoff_s=float(model.pod_initial_backoff_seconds),
        max_backoff_s=float(model.pod_max_backoff_seconds),
        compat_version=model.compat_version,
        kubeconfig=model.client_connection.kubeconfig,
        third_party=tuple(sorted(catalogue.classes.keys() - built_in_names)),
        warnings=(*_warnings(model), *validation.disabled_in_vain(model.profiles, catalogue.classes)),
    )


def parse_shape(document: object) -> dict[str, Any]:
    """Returns the document as it is read, without nulls. Raises ConfigError where its shape is not that of a configuration."""
    shaped = _as_decoded(document)
    _, unknown_fields = _model(shaped)
    if unknown_fields or not isinstance(shaped, dict):
        raise ConfigError(unknown_fields or ["configuration: Input should be a mapping"])
    return shaped


def _model(document: object) -> tuple[ConfigurationModel, list[str]]:
    """The typed document, and its unknown fields: without those the rest is still checked, so all problems are reported at once."""
    try:
        return ConfigurationModel.model_validate(document), []
    except ValidationError as error:
        problems = _shape_problems(error)
        unknown = [found["loc"] for found in error.errors() if found["type"] == "extra_forbidden"]
        if len(unknown) < len(problems):
            raise ConfigError(problems) from error
    rest = copy.deepcopy(document)
    for location in unknown:
        _remove(rest, location)
    return ConfigurationModel.model_validate(rest), problems


def _remove(document: Any, location: Sequence[int | str]) -> None:
    for part in location[:-1]:
        document = document[part]
    del document[location[-1]]


def _as_decoded(document: object) -> object:
    """As upstream decodes it: a field that is null is left out (templates write such fields), and 5.0 is the integer 5."""
    if isinstance(document, dict):
        return {key: _as_decoded(value) for key, value in document.items() if value is not None}
    if isinstance(document, list):
        return [_as_decoded(value) for value in document]
    if isinstance(document, float) and document.is_integer() and abs(document) < MOST_WHOLE:
        return int(document)
    return document


def _spec(profile: ProfileModel, catalogue: Catalogue, compat_version: str) -> ProfileSpec:
    points = {
        str(info.alias): _plugin_set(getattr(profile.plugins, name))
        for name, info in type(profile.plugins).model_fields.items()
        if name in profile.plugins.model_fields_set and info.alias in PLACES
    }
    return ProfileSpec(
        scheduler_name=profile.scheduler_name or SCHEDULER_NAME,
        plugins=points,
        plugin_config=_plugin_config(profile, catalogue, compat_version),
    )


def _plugin_config(profile: ProfileModel, catalogue: Catalogue, compat_version: str) -> dict[str, dict[str, Any]]:
    """Arguments by plugin. Another release than the usual one is an argument of each plugin that knows releases."""
    args: dict[str, dict[str, Any]] = {
        entry.name: {
            name: value for name, value in entry.args.items() if name not in IGNORED_ARGUMENTS.get(entry.name, ())
        }
        for entry in profile.plugin_config
    }
    if compat_version == ConfigurationModel.model_fields["compat_version"].default:
        return args
    for name, cls in catalogue.classes.items():
        if "compat_version" in getattr(getattr(cls, "Args", None), "__struct_fields__", ()):
            args[name] = {"compatVersion": compat_version, **args.get(name, {})}
    return args


def _plugin_set(found: PluginSetModel) -> PluginSet:
    return PluginSet(
        enabled=tuple(PluginRef(ref.name, ref.weight) for ref in found.enabled),
        disabled=tuple(PluginRef(ref.name) for ref in found.disabled),
    )


def _enabled(profiles: Sequence[ProfileModel]) -> Iterator[tuple[str, str]]:
    """(path, plugin name) of every plugin that a profile enables or configures."""
    for index, profile in enumerate(profiles):
        path = f"profiles[{index}]"
        for name, info in type(profile.plugins).model_fields.items():
            for at, ref in enumerate(getattr(profile.plugins, name).enabled):
                yield f"{path}.plugins.{info.alias}.enabled[{at}].name", ref.name
        for at, entry in enumerate(profile.plugin_config):
            yield f"{path}.pluginConfig[{at}].name", entry.name


def _plugin_names(profiles: Sequence[ProfileModel]) -> list[str]:
    return [name for _, name in _enabled(profiles)]


def _name_problems(profiles: Sequence[ProfileModel], unknown: Mapping[str, str]) -> list[str]:
    return [f"{path}: {unknown[name]}" for path, name in _enabled(profiles) if name in unknown]


def _leader_election(model: LeaderElectionModel) -> LeaderElection:
    return LeaderElection(
        enabled=model.leader_elect,
        name=model.resource_name or str(LeaderElectionModel.model_fields["resource_name"].default),
        namespace=model.resource_namespace,
        lease_s=validation.election_s(model, "lease_duration"),
        renew_s=validation.election_s(model, "renew_deadline"),
        retry_s=validation.election_s(model, "retry_period"),
    )


def _warnings(model: ConfigurationModel) -> list[str]:
    found = []
    if "parallelism" in model.model_fields_set:
        found.append("parallelism is accepted and ignored: one event loop evaluates all nodes at once")
    if model.client_connection.model_fields_set & {"qps", "burst"}:
        found.append("clientConnection.qps and burst are accepted and ignored: the API server's own fairness limits us")
    found += [
        f"clientConnection.{path} is accepted and ignored: application/json is what this client speaks"
        for path, value in (
            ("contentType", model.client_connection.content_type),
            ("acceptContentTypes", model.client_connection.accept_content_types),
        )
        if value not in ("", "application/json")
    ]
    election = model.leader_election
    if election.leader_elect and (election.resource_namespace, election.resource_name) == KUBE_SCHEDULERS_LEASE:
        text = "is kube-scheduler's own Lease: while it leads, this scheduler places nothing, and the other way round"
        found.append(f"leaderElection: {'/'.join(KUBE_SCHEDULERS_LEASE)} {text}")
    sampled = {"percentageOfNodesToScore": model.percentage_of_nodes_to_score}
    for index, profile in enumerate(model.profiles):
        sampled[f"profiles[{index}].percentageOfNodesToScore"] = profile.percentage_of_nodes_to_score
    found += [
        f"{path} is accepted and ignored: all nodes are always filtered and scored"
        for path, value in sampled.items()
        if value not in (None, 0, 100)
    ]
    profiling = {"enableProfiling": "enable_profiling", "enableContentionProfiling": "enable_contention_profiling"}
    for path, name in profiling.items():
        if name in model.model_fields_set and getattr(model, name):
            found.append(f"{path} is accepted and ignored: there are no profiles to be served")
    return [*found, *_ignored_arguments(model.profiles)]


def _ignored_arguments(profiles: Sequence[ProfileModel]) -> Iterator[str]:
    for index, profile in enumerate(profiles):
        for at, entry in enumerate(profile.plugin_config):
            for name, why in IGNORED_ARGUMENTS.get(entry.name, {}).items():
                if name in entry.args:
                    yield f"profiles[{index}].pluginConfig[{at}].args.{name} is accepted and ignored: {why}"


def _shape_problems(error: ValidationError) -> list[str]:
    """Pydantic's findings in the words of a strict decoder."""
    problems = []
    for found in error.errors():
        path = _path(found["loc"])
        if found["type"] == "extra_forbidden":
            problems.append(f'strict decoding error: unknown field "{path}"')
        elif found["type"] == "missing":
            problems.append(f"{path}: Required value")
        elif found["type"] == "model_type":  # its own text names a class of ours
            problems.append(validation.invalid(path, found["input"], "Input should be a mapping"))
        else:
            problems.append(validation.invalid(path, found["input"], found["msg"]))
    return problems


def _path(location: Sequence[int | str]) -> str:
    path = ""
    for part in location:
        path += f"[{part}]" if isinstance(part, int) else f".{part}" if path else part
    return path or "configuration"
