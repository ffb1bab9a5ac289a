"""Value checks of the configuration with upstream's texts (reference: kube-scheduler 1.37.1).

Every check returns texts of the form `path: Invalid value: v: what is allowed`; all of them are reported at once.
"""

from collections.abc import Collection, Iterator, Sequence
from typing import Final

from robotapp_api.values.quantities.duration import parse_go_ns
from robotapp_client.tools.leader_election import JITTER
from robotapp_scheduler.config.model import (
    API_VERSION,
    ClientConnectionModel,
    ConfigurationModel,
    LeaderElectionModel,
    ProfileModel,
)
from robotapp_scheduler.core.framework.profiles import PLACES

COMPAT_VERSIONS = ("1.35", "1.37")
ELECTION_TIMES: Final = ("lease_duration", "renew_deadline", "retry_period")


def check(config: ConfigurationModel) -> list[str]:
    """All problems of a well-formed configuration, in file order; empty when it may be used."""
    return [
        *_top_level(config),
        *_leader_election(config.leader_election),
        *_client(config.client_connection),
        *_profile_names(config.profiles),
        *(text for index, profile in enumerate(config.profiles) for text in _profile(profile, f"profiles[{index}]")),
    ]


def argument_kinds(profiles: Sequence[ProfileModel], built_in: Collection[str]) -> Iterator[str]:
    """Arguments whose kind is that of another plugin, or of another version of the format."""
    for index, profile in enumerate(profiles):
        for at, entry in enumerate(profile.plugin_config):
            expected = {"apiVersion": API_VERSION, "kind": f"{entry.name}Args"} if entry.name in built_in else {}
            for field, value in expected.items():
                if entry.args.get(field, value) != value:
                    path = f"profiles[{index}].pluginConfig[{at}].args.{field}"
                    yield invalid(path, entry.args[field], f'must be "{value}"')


def election_s(model: LeaderElectionModel, name: str) -> float:
    """One of ELECTION_TIMES in seconds; 0 stands for the default, as upstream. Raises ValueError when it is no time."""
    default: str = LeaderElectionModel.model_fields[name].default
    return (parse_go_ns(getattr(model, name)) or parse_go_ns(default)) / 1e9


def disabled_in_vain(profiles: Sequence[ProfileModel], known: Collection[str]) -> Iterator[str]:
    """Names in `disabled` lists that no plugin has, perhaps misspelt: upstream lets them pass, and so do we, aloud."""
    for index, profile in enumerate(profiles):
        for name, info in type(profile.plugins).model_fields.items():
            for at, ref in enumerate(getattr(profile.plugins, name).disabled):
                if ref.name != "*" and ref.name not in known:
                    path = f"profiles[{index}].plugins.{info.alias}.disabled[{at}].name"
                    yield f'{path}: no plugin is called "{ref.name}": nothing is disabled by it'


def invalid(path: str, value: object, allowed: str) -> str:
    shown = f'"{value}"' if isinstance(value, str) else value
    return f"{path}: Invalid value: {shown}: {allowed}"


def unsupported(path: str, why: str) -> str:
    return f"{path}: not supported here: {why}"


def _top_level(config: ConfigurationModel) -> Iterator[str]:
    if config.compat_version not in COMPAT_VERSIONS:
        allowed = ", ".join(f'"{version}"' for version in COMPAT_VERSIONS)
        yield f'compatVersion: Unsupported value: "{config.compat_version}": supported values: {allowed}'
    if config.parallelism <= 0:
        yield invalid("parallelism", config.parallelism, "should be an integer value greater than zero")
    yield from _percentage("percentageOfNodesToScore", config.percentage_of_nodes_to_score)
    if config.pod_initial_backoff_seconds <= 0:
        yield invalid("podInitialBackoffSeconds", config.pod_initial_backoff_seconds, "must be greater than 0")
    if config.pod_max_backoff_seconds < config.pod_initial_backoff_seconds:
        text = "must be greater than or equal to PodInitialBackoffSeconds"
        yield invalid("podMaxBackoffSeconds", config.pod_max_backoff_seconds, text)
    if config.extenders:
        yield unsupported("extenders", "an HTTP round trip per pod; write a plugin (module:Class) instead")
    if config.delay_cache_until_active:
        yield unsupported("delayCacheUntilActive", "standby caches are kept warm, so that taking over costs no re-list")


def _percentage(path: str, value: int | None) -> Iterator[str]:
    if value is not None and not 0 <= value <= 100:
        yield invalid(path, value, "not in valid range [0-100]")


def _leader_election(model: LeaderElectionModel) -> Iterator[str]:
    seconds: dict[str, float] = {}
    for name in ELECTION_TIMES:
        try:
            seconds[name] = election_s(model, name)
        except ValueError:
            yield invalid(_election_path(name), getattr(model, name), 'must be a duration such as "15s"')
    if not model.leader_elect:
        return
    if model.resource_lock not in ("", "leases"):
        yield invalid("leaderElection.resourceLock", model.resource_lock, 'resourceLock value must be "leases"')
    for name, value in seconds.items():
        if value <= 0:
            yield invalid(_election_path(name), getattr(model, name), "must be greater than zero")
    if len(seconds) < len(ELECTION_TIMES):
        return
    if seconds["lease_duration"] <= seconds["renew_deadline"]:
        yield invalid("leaderElection.leaseDuration", model.lease_duration, "must be greater than `RenewDeadline`")
    if seconds["renew_deadline"] <= seconds["retry_period"]:
        yield invalid("leaderElection.renewDeadline", model.renew_deadline, "must be greater than `RetryPeriod`")
    elif seconds["renew_deadline"] <= seconds["retry_period"] * (1 + JITTER):
        # kube-scheduler takes the file and ends when it would elect.
        text = f"must be greater than {1 + JITTER} times `RetryPeriod`, which is how long a pause may last"
        yield invalid("leaderElection.renewDeadline", model.renew_deadline, text)


def _election_path(name: str) -> str:
    return f"leaderElection.{LeaderElectionModel.model_fields[name].alias}"


def _client(model: ClientConnectionModel) -> Iterator[str]:
    if model.burst < 0:
        yield invalid("clientConnection.burst", model.burst, "must be non-negative")


def _profile_names(profiles: list[ProfileModel]) -> Iterator[str]:
    seen: dict[str, int] = {}
    for index, profile in enumerate(profiles):
        name = profile.scheduler_name
        if name == "" or (name is None and len(profiles) > 1):
            yield f"profiles[{index}].schedulerName: Required value"
        if name and name in seen:
            yield f'profiles[{index}].schedulerName: Duplicate value: "profiles[{seen[name]}].schedulerName"'
        seen.setdefault(name or "", index)


def _profile(profile: ProfileModel, path: str) -> Iterator[str]:
    for name, info in type(profile.plugins).model_fields.items():
        enabled = getattr(profile.plugins, name).enabled
        if enabled and info.alias not in PLACES:
            yield unsupported(f"{path}.plugins.{info.alias}", "the pods of a group are planned whole without it")
        for index, ref in enumerate(enabled):
            if ref.weight < 0:
                at = f"{path}.plugins.{info.alias}.enabled[{index}].weight"
                yield invalid(at, ref.weight, "should be an integer value greater than or equal to zero")
    yield from _percentage(f"{path}.percentageOfNodesToScore", profile.percentage_of_nodes_to_score)
    names: set[str] = set()
    for index, entry in enumerate(profile.plugin_config):
        if entry.name in names:
            yield f'{path}.pluginConfig[{index}]: Duplicate value: "{entry.name}"'
        names.add(entry.name)
