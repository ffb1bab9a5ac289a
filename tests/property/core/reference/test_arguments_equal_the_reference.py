"""Plugin arguments other than the defaults, against the scalar reference: whole decisions, not single scores.

A third of the cases each day; ROBOTAPP_SAMPLES=all takes all of them.
"""

from typing import Any

import pytest
from tests.support.seeds import choose_for_today

from campaigns.cluster_cases import FAMILIES, seeded_case
from campaigns.reference_scheduler import Config
from campaigns.reference_scheduler.comparison import differences
from robotapp_scheduler.config.load import parse
from robotapp_scheduler.config.model import API_VERSION, KIND
from robotapp_scheduler.plugins.kubernetes.common.arguments import OLD
from robotapp_scheduler.plugins.registry import catalogue

Json = dict[str, Any]
CASES = 80
REQUIRED = "requiredDuringSchedulingIgnoredDuringExecution"
PREFERRED = "preferredDuringSchedulingIgnoredDuringExecution"
DISK = {"matchExpressions": [{"key": "disk", "operator": "Exists"}]}
RACK = {"matchExpressions": [{"key": "rack", "operator": "In", "values": ["r0"]}]}
ADDED = {
    REQUIRED: {"nodeSelectorTerms": [DISK]},
    PREFERRED: [{"weight": 7, "preference": RACK}],
}
LISTED = (
    {"maxSkew": 1, "topologyKey": "topology.kubernetes.io/zone", "whenUnsatisfiable": "DoNotSchedule"},
    {"maxSkew": 2, "topologyKey": "rack", "whenUnsatisfiable": "ScheduleAnyway"},
)
SHAPE = ((0, 2), (40, 9), (100, 1))
RATIO = {
    "type": "RequestedToCapacityRatio",
    "resources": [{"name": "cpu", "weight": 3}, {"name": "example.com/gpu", "weight": 1}],
    "requestedToCapacityRatio": {"shape": [{"utilization": at, "score": score} for at, score in SHAPE]},
}
NODE = ("required-affinity", "preferred-affinity", "node-selector", "named-nodes")
AFFINITY = ("preferred-pod-affinity", "affinity-namespaces", "pod-affinity")
SPREAD = ("default-spread", "soft-spread")
AMOUNTS = ("extended", "amounts", "init-steps", "preemption")
STORAGE = ("static-volumes", "storage-capacity")


@pytest.mark.parametrize(
    ("families", "config", "args"),
    [
        (NODE, Config(added_affinity=ADDED), {"NodeAffinity": {"addedAffinity": ADDED}}),
        (AFFINITY, Config(hard_pod_affinity_weight=0), {"InterPodAffinity": {"hardPodAffinityWeight": 0}}),
        (AFFINITY, Config(hard_pod_affinity_weight=100), {"InterPodAffinity": {"hardPodAffinityWeight": 100}}),
        (
            AFFINITY,
            Config(ignore_preferred_terms_of_existing_pods=True),
            {"InterPodAffinity": {"ignorePreferredTermsOfExistingPods": True}},
        ),
        (
            SPREAD,
            Config(spread_defaults=LISTED),
            {"PodTopologySpread": {"defaultingType": "List", "defaultConstraints": list(LISTED)}},
        ),
        (SPREAD, Config(spread_defaults=()), {"PodTopologySpread": {"defaultingType": "List"}}),
        (
            AMOUNTS,
            Config(ignored_resources=("example.com/gpu",)),
            {"NodeResourcesFit": {"ignoredResources": ["example.com/gpu"]}},
        ),
        (
            AMOUNTS,
            Config(ignored_resource_groups=("example.com",)),
            {"NodeResourcesFit": {"ignoredResourceGroups": ["example.com"]}},
        ),
        (AMOUNTS, Config(fit_strategy=RATIO), {"NodeResourcesFit": {"scoringStrategy": RATIO}}),
        (
            STORAGE,
            Config(volume_shape=SHAPE),
            {"VolumeBinding": {"shape": [{"utilization": at, "score": score} for at, score in SHAPE]}},
        ),
    ],
    ids=[
        "added affinity",
        "required terms of others do not score",
        "required terms of others score high",
        "preferred terms of others ignored",
        "listed defaults",
        "no defaults",
        "ignored resource",
        "ignored group",
        "ratio",
        "shape of storage",
    ],
)
def test_decisions_with_arguments(families: tuple[str, ...], config: Config, args: dict[str, Json]) -> None:
    for number in choose_for_today(range(CASES)):
        case = seeded_case("arguments", number=number, families=families)
        assert differences(case, config=config, args=args) == [], f"case {number}: {case.families}"


def test_the_formulas_of_1_35_in_whole_decisions() -> None:
    """Of all families but a resize in place, whose older sum is not built (docs/parity.md)."""
    families = [name for name in FAMILIES if name != "resize"]
    document = {"apiVersion": API_VERSION, "kind": KIND, "compatVersion": OLD}
    (profile,) = parse(document, catalogue=catalogue()).profiles
    args = profile.plugin_config
    newer = 0
    cases = choose_for_today(range(4 * len(families)))
    for number in cases:
        case = seeded_case("1.35", number=number, families=families)
        assert differences(case, config=Config(compat_version=OLD), args=args) == [], f"case {number}: {case.families}"
        newer += any(not unlike.startswith("text ") for unlike in differences(case, args=args))
    assert newer > len(cases) / 10, "hardly a case in which the releases differ proves nothing"
