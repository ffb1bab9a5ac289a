"""Reads a `KubeSchedulerConfiguration` file into plain, frozen values, or says everything that is wrong with it.

The result is what the process runs with and what `/configz` shows. Without a file the built-in configuration serves
two profiles with the same plugins: `ros-aware-scheduler` and `kubernetes-scheduler` (the name the thesis' files use).
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from robotapp_api.model.names import SCHEDULER_NAME, THESIS_SCHEDULER_NAME
from robotapp_api.values.duration import parse_us
from robotapp_scheduler import config_checks, config_yaml
from robotapp_scheduler.config_args import ARGS, Args
from robotapp_scheduler.config_model import (
    API_VERSION,
    KIND,
    ConfigurationModel,
    LeaderElectionModel,
    PluginConfig,
    ProfileModel,
)
from robotapp_scheduler.config_plugins import DuplicatePluginError, PluginUse, effective
from robotapp_scheduler.plugin_catalog import Catalog


class ConfigError(ValueError):
    """The configuration cannot be used. `problems` holds one text per mistake, each naming its path."""

    def __init__(self, problems: Sequence[str]) -> None:
        self.problems = tuple(problems)
        super().__init__(problems[0] if len(problems) == 1 else "[" + ", ".join(problems) + "]")


@dataclass(frozen=True, slots=True)
class ProfileConfig:
    """One scheduler name: the plugins of every point in order, and the arguments of those that have any."""

    scheduler_name: str
    points: Mapping[str, tuple[PluginUse, ...]]
    args: Mapping[str, Mapping[str, Any]]


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

    profiles: tuple[ProfileConfig, ...]
    leader_election: LeaderElection
    initial_backoff_s: float = 1.0
    max_backoff_s: float = 10.0
    compat_version: str = "1.37"
    kubeconfig: str = ""
    qps: float = 0.0
    burst: int = 0
    warnings: tuple[str, ...] = field(default=(), compare=False)

    def as_json(self) -> dict[str, Any]:
        """Plain JSON for `/configz`."""
        return asdict(self)

    @property
    def digest(self) -> str:
        text = json.dumps(self.as_json(), sort_keys=True, default=str)
        return hashlib.sha256(text.encode()).hexdigest()[:12]


def load(path: Path | None, *, catalog: Catalog) -> SchedulerConfig:
    """The configuration of a file, or the built-in one without a file.

    Raises `ConfigError` with every problem found; nothing of a faulty file is used.
    """
    if path is None:
        return built_in(catalog)
    try:
        document = config_yaml.read(path)
    except OSError as error:
        raise ConfigError([f"{path}: {error.strerror}"]) from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ConfigError([f"strict decoding error: yaml: {error}"]) from error
    return parse(document, catalog=catalog)


def built_in(catalog: Catalog) -> SchedulerConfig:
    names = (SCHEDULER_NAME, THESIS_SCHEDULER_NAME)
    document = {"apiVersion": API_VERSION, "kind": KIND, "profiles": [{"schedulerName": name} for name in names]}
    return parse(document, catalog=catalog)


def parse(document: object, *, catalog: Catalog) -> SchedulerConfig:
    """A decoded document to a configuration; see `load`."""
    try:
        model = ConfigurationModel.model_validate(document)
    except ValidationError as error:
        raise ConfigError(_shape_problems(error)) from error
    problems = config_checks.check(model)
    profiles = [
        _profile(profile, f"profiles[{index}]", catalog=catalog, problems=problems)
        for index, profile in enumerate(model.profiles or [ProfileModel()])
    ]
    problems += _queue_sort_problems(profiles)
    if problems:
        raise ConfigError(problems)
    return SchedulerConfig(
        profiles=tuple(profiles),
        leader_election=_leader_election(model.leader_election),
        initial_backoff_s=float(model.pod_initial_backoff_seconds),
        max_backoff_s=float(model.pod_max_backoff_seconds),
        compat_version=model.compat_version,
        kubeconfig=model.client_connection.kubeconfig,
        qps=model.client_connection.qps,
        burst=model.client_connection.burst,
        warnings=tuple(_warnings(model)),
    )


def _profile(profile: ProfileModel, path: str, *, catalog: Catalog, problems: list[str]) -> ProfileConfig:
    problems += _plugin_problems(profile, path, catalog)
    points: dict[str, tuple[PluginUse, ...]] = {}
    try:
        points = effective(catalog.defaults, profile.plugins, points_of=catalog.points_of)
    except DuplicatePluginError as error:
        problems.append(f'{path}.plugins: plugin "{error}" already registered')
    args: dict[str, Mapping[str, Any]] = {}
    for index, entry in enumerate(profile.plugin_config):
        try:
            args[entry.name] = _args(entry, catalog)
        except ValidationError as error:
            prefix = f"{path}.pluginConfig[{index}].args"
            problems += _shape_problems(error, prefix=prefix)
        except LookupError as error:
            problems.append(f"{path}.pluginConfig[{index}].name: {error.args[0]}")
    return ProfileConfig(scheduler_name=profile.scheduler_name or SCHEDULER_NAME, points=points, args=args)


def _plugin_problems(profile: ProfileModel, path: str, catalog: Catalog) -> list[str]:
    problems = []
    for point, info in type(profile.plugins).model_fields.items():
        refs = getattr(profile.plugins, point).enabled
        for index, ref in enumerate(refs):
            if why := catalog.problem(ref.name, point=str(info.alias)):
                problems.append(f"{path}.plugins.{info.alias}.enabled[{index}].name: {why}")
    return problems


def _args(entry: PluginConfig, catalog: Catalog) -> Mapping[str, Any]:
    """Checked arguments in snake_case for our own plugins, as written for third-party ones."""
    if why := catalog.problem(entry.name, point="multiPoint"):
        raise LookupError(why)
    if catalog.is_third_party(entry.name):
        return entry.args
    model = ARGS.get(entry.name, Args)
    return model.model_validate(entry.args).model_dump(exclude={"api_version", "kind"}, exclude_none=True)


def _queue_sort_problems(profiles: Sequence[ProfileConfig]) -> list[str]:
    problems = []
    for index, profile in enumerate(profiles):
        sorters = profile.points.get("queueSort", ())
        if len(sorters) > 1:
            problems.append(f"profiles[{index}].plugins.queueSort: only one queue sort plugin can be enabled")
        elif profile.points and not sorters:
            problems.append(f"profiles[{index}].plugins.queueSort: one queue sort plugin is needed")
        if profile.points and not profile.points["bind"]:
            problems.append(f"profiles[{index}].plugins.bind: at least one bind plugin is needed")
    keys = {(profile.points.get("queueSort"), str(_queue_args(profile))) for profile in profiles}
    if not problems and len(keys) > 1:
        problems.append("profiles: queueSort must be the same for all profiles")
    return problems


def _queue_args(profile: ProfileConfig) -> Mapping[str, Any]:
    sorters = profile.points.get("queueSort", ())
    return profile.args.get(sorters[0].name, {}) if sorters else {}


def _leader_election(model: LeaderElectionModel) -> LeaderElection:
    return LeaderElection(
        enabled=model.leader_elect,
        name=model.resource_name,
        namespace=model.resource_namespace,
        lease_s=parse_us(model.lease_duration) / 1e6,
        renew_s=parse_us(model.renew_deadline) / 1e6,
        retry_s=parse_us(model.retry_period) / 1e6,
    )


def _warnings(model: ConfigurationModel) -> list[str]:
    if "parallelism" in model.model_fields_set:
        return ["parallelism is accepted and ignored: one event loop evaluates all nodes at once"]
    return []


def _shape_problems(error: ValidationError, *, prefix: str = "") -> list[str]:
    """Pydantic's findings in the words of a strict decoder."""
    problems = []
    for found in error.errors():
        path = _path(found["loc"], prefix)
        if found["type"] == "extra_forbidden":
            problems.append(f'strict decoding error: unknown field "{path}"')
        elif found["type"] == "missing":
            problems.append(f"{path}: Required value")
        else:
            problems.append(config_checks.invalid(path, found["input"], found["msg"]))
    return problems


def _path(location: Sequence[int | str], prefix: str) -> str:
    path = prefix
    for part in location:
        path += f"[{part}]" if isinstance(part, int) else f".{part}" if path else part
    return path or "configuration"
