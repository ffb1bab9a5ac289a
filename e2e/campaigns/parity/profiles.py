"""Plugin arguments for the comparison with kube-scheduler: the same profiles on both sides, under a name of their own.

A profile's name is that of the scheduler plus a suffix; most pods use the default one.
"""

from collections.abc import Mapping, Sequence
from random import Random
from typing import Any, Final

from campaigns.cluster_cases import ALL_FAMILIES

Json = dict[str, Any]
GPU: Final = "example.com/gpu"
DISK_OR_ZONE: Final = {
    "requiredDuringSchedulingIgnoredDuringExecution": {
        "nodeSelectorTerms": [
            {"matchExpressions": [{"key": "disk", "operator": "Exists"}]},
            {"matchFields": [{"key": "metadata.name", "operator": "In", "values": ["n0"]}]},
        ]
    },
    "preferredDuringSchedulingIgnoredDuringExecution": [
        {"weight": 7, "preference": {"matchExpressions": [{"key": "rack", "operator": "In", "values": ["r0"]}]}}
    ],
}


def _fit(kind: str, resources: Sequence[tuple[str, int]], **more: Any) -> Json:
    weights = [{"name": name, "weight": weight} for name, weight in resources]
    strategy: Json = {"type": kind, "resources": weights}
    if shape := more.pop("shape", None):
        points = [{"utilization": at, "score": score} for at, score in shape]
        strategy["requestedToCapacityRatio"] = {"shape": points}
    return {"NodeResourcesFit": {"scoringStrategy": strategy, **more}}


PROFILES: Final[Mapping[str, Json]] = {
    "": {},
    "-packed": _fit("MostAllocated", (("cpu", 3), ("memory", 1), (GPU, 5))),
    "-ratio": _fit(
        "RequestedToCapacityRatio", (("cpu", 2), ("memory", 1), (GPU, 3)), shape=((0, 0), (40, 9), (70, 3), (100, 10))
    ),
    "-blind": {
        **_fit("LeastAllocated", (("cpu", 1), ("ephemeral-storage", 2), (GPU, 2)), ignoredResources=[GPU]),
        "NodeResourcesBalancedAllocation": {
            "resources": [{"name": "cpu", "weight": 1}, {"name": "memory", "weight": 1}, {"name": GPU, "weight": 1}]
        },
    },
    "-group": _fit("LeastAllocated", (("memory", 2),), ignoredResourceGroups=["example.com"]),
    "-enforced": {"NodeAffinity": {"addedAffinity": DISK_OR_ZONE}},
    "-shaped": {
        "VolumeBinding": {"shape": [{"utilization": at, "score": score} for at, score in ((0, 1), (50, 8), (100, 4))]}
    },
    "-listed": {
        "PodTopologySpread": {
            "defaultingType": "List",
            "defaultConstraints": [
                {"topologyKey": "topology.kubernetes.io/zone", "whenUnsatisfiable": "DoNotSchedule", "maxSkew": 1},
                {"topologyKey": "kubernetes.io/hostname", "whenUnsatisfiable": "ScheduleAnyway", "maxSkew": 2},
            ],
        }
    },
    "-social": {"InterPodAffinity": {"hardPodAffinityWeight": 37, "ignorePreferredTermsOfExistingPods": True}},
    "-reserved": {"InterPodAffinity": {"hardPodAffinityWeight": 0}},
    "-ordered": {},
}
"""Suffix to arguments by plugin."""
PLUGINS: Final[Mapping[str, Json]] = {
    "-ordered": {
        "multiPoint": {"enabled": [{"name": "TaintToleration", "weight": 5}], "disabled": [{"name": "NodePorts"}]},
        "filter": {
            "enabled": [{"name": "PodTopologySpread"}, {"name": "NodeResourcesFit"}, {"name": "NodeAffinity"}],
            "disabled": [{"name": "NodeAffinity"}],
        },
        "score": {
            "enabled": [
                {"name": "PodTopologySpread"},
                {"name": "ImageLocality", "weight": 9},
                {"name": "NodeAffinity", "weight": 4},
            ],
            "disabled": [{"name": "NodeResourcesFit"}],
        },
    }
}
"""Suffix to plugin lists, where they are not the default ones."""


def suffix(seed: str, number: int, families: Sequence[str]) -> str:
    """The profile of a case. Preemption stays with the default one: the reference that judges its ties has that."""
    random = Random(f"{seed}/{number}/profile")
    if any("DefaultPreemption" in ALL_FAMILIES[name].plugins for name in families) or random.random() > 0.4:
        return ""
    return random.choice(tuple(PROFILES))


def profiles(scheduler: str) -> list[Json]:
    """The profiles block of a configuration."""
    return [
        {
            "schedulerName": f"{scheduler}{end}",
            "plugins": PLUGINS.get(end, {}),
            "pluginConfig": [{"name": name, "args": args} for name, args in arguments.items()],
        }
        for end, arguments in PROFILES.items()
    ]
