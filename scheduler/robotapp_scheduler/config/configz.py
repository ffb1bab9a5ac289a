"""A configuration as `/configz` shows it: a KubeSchedulerConfiguration with everything spelled out, which can be used again."""

from typing import Any

from robotapp_scheduler.config.load import LeaderElection, SchedulerConfig
from robotapp_scheduler.config.model import API_VERSION, KIND
from robotapp_scheduler.core.framework.profiles import Catalogue, ProfileSpec, expand


def document(config: SchedulerConfig) -> dict[str, Any]:
    """What the file would say that leaves nothing to defaults: every plugin of every point, in order, with its weight."""
    catalogue = config.catalogue.meant_by(config.profiles)
    return {
        "apiVersion": API_VERSION,
        "kind": KIND,
        "compatVersion": config.compat_version,
        "percentageOfNodesToScore": 100,
        "podInitialBackoffSeconds": int(config.initial_backoff_s),
        "podMaxBackoffSeconds": int(config.max_backoff_s),
        "clientConnection": {"kubeconfig": config.kubeconfig},
        "leaderElection": _election(config.leader_election),
        "profiles": [_profile(spec, catalogue) for spec in config.profiles],
    }


def _profile(spec: ProfileSpec, catalogue: Catalogue) -> dict[str, Any]:
    points = expand(spec.plugins, catalogue, "", [])
    return {
        "schedulerName": spec.scheduler_name,
        "plugins": {
            point: {
                "enabled": [
                    {"name": ref.name, "weight": ref.weight or 1} if point == "score" else {"name": ref.name}
                    for ref in refs
                ],
                "disabled": [{"name": "*"}],
            }
            for point, refs in points.items()
        },
        "pluginConfig": [{"name": name, "args": dict(args)} for name, args in spec.plugin_config.items()],
    }


def _election(election: LeaderElection) -> dict[str, Any]:
    return {
        "leaderElect": election.enabled,
        "leaseDuration": _duration(election.lease_s),
        "renewDeadline": _duration(election.renew_s),
        "retryPeriod": _duration(election.retry_s),
        "resourceLock": "leases",
        "resourceName": election.name,
        "resourceNamespace": election.namespace,
    }


def _duration(seconds: float) -> str:
    return f"{seconds:.6f}".rstrip("0").rstrip(".") + "s"
