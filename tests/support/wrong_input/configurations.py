"""KubeSchedulerConfigurations as users carry them over, and whether kube-scheduler 1.37 takes them."""

from typing import Any, Final

import pytest

from robotapp_scheduler.config.load import ConfigError, SchedulerConfig, parse
from robotapp_scheduler.config.model import API_VERSION, KIND
from robotapp_scheduler.core.framework.profiles import Catalogue

Json = dict[str, Any]
PROTOBUF: Final = "application/vnd.kubernetes.protobuf"
REQUIRED: Final = "requiredDuringSchedulingIgnoredDuringExecution"
PREFERRED: Final = "preferredDuringSchedulingIgnoredDuringExecution"


def config(known: Catalogue, **fields: Any) -> SchedulerConfig:
    """What a file with these fields says, with these plugins."""
    return parse({"apiVersion": API_VERSION, "kind": KIND, **fields}, catalogue=known)


def problems(known: Catalogue, **fields: Any) -> list[str]:
    """What is wrong with such a file."""
    with pytest.raises(ConfigError) as caught:
        config(known, **fields)
    return list(caught.value.problems)


def profile(**fields: Any) -> Json:
    """The field `profiles` with one of them."""
    return {"profiles": [{"schedulerName": "mine", **fields}]}


def plugins(point: str, *enabled: Json, disabled: tuple[str, ...] = ()) -> Json:
    return profile(plugins={point: {"enabled": list(enabled), "disabled": [{"name": name} for name in disabled]}})


def args(plugin: str, **fields: Any) -> Json:
    return profile(pluginConfig=[{"name": plugin, "args": fields}])


def strategy(kind: str = "LeastAllocated", **fields: Any) -> Json:
    return args("NodeResourcesFit", scoringStrategy={"type": kind, **fields})


def ratio(*shape: tuple[int, int]) -> Json:
    points = [{"utilization": utilization, "score": score} for utilization, score in shape]
    return strategy("RequestedToCapacityRatio", requestedToCapacityRatio={"shape": points})


def term(operator: str) -> Json:
    return {"matchExpressions": [{"key": "disk", "operator": operator, "values": ["1"]}]}


ACCEPTED: Final[dict[str, Json]] = {
    "nothing but defaults": {},
    "two profiles": {"profiles": [{"schedulerName": "a"}, {"schedulerName": "b"}]},
    "fields that are null": {"profiles": None, "leaderElection": None, "extenders": None},
    "plugin lists that are null": profile(plugins={"score": {"enabled": None}}, pluginConfig=None),
    "sampling": {"percentageOfNodesToScore": 50},
    "sampling of a profile": profile(percentageOfNodesToScore=30),
    "parallelism": {"parallelism": 32},
    "back-off": {"podInitialBackoffSeconds": 2, "podMaxBackoffSeconds": 20},
    "equal back-offs": {"podInitialBackoffSeconds": 5, "podMaxBackoffSeconds": 5},
    "client limits": {"clientConnection": {"qps": 200.5, "burst": 400}},
    "protobuf": {"clientConnection": {"contentType": PROTOBUF, "acceptContentTypes": f"{PROTOBUF},application/json"}},
    "profiling": {"enableProfiling": True, "enableContentionProfiling": False},
    "election": {"leaderElection": {"leaseDuration": "30s", "renewDeadline": "20s", "retryPeriod": "2s"}},
    "no election, another lock": {"leaderElection": {"leaderElect": False, "resourceLock": "endpoints"}},
    "election, zero is the default": {"leaderElection": {"leaseDuration": "0s", "renewDeadline": "0", "retryPeriod": "0s"}},
    "election, empty is the default": {"leaderElection": {"resourceName": "", "resourceLock": ""}},
    "election, times as Go reads them": {"leaderElection": {"leaseDuration": "+.5m", "renewDeadline": "9000000µs", "retryPeriod": "500000000ns"}},
    "no election, its times do not matter": {"leaderElection": {"leaderElect": False, "retryPeriod": "-3s"}},
    "integers with a fraction of nothing": {
        "parallelism": 8.0, "podInitialBackoffSeconds": 2.0, "percentageOfNodesToScore": 50.0, "clientConnection": {"burst": 5.0},
        **plugins("score", {"name": "ImageLocality", "weight": 3.0})},
    "integers with a fraction of nothing, in arguments": profile(pluginConfig=[
        {"name": "InterPodAffinity", "args": {"hardPodAffinityWeight": 5.0}},
        {"name": "VolumeBinding", "args": {"bindTimeoutSeconds": 5.0, "shape": [{"utilization": 0.0, "score": 5.0}]}},
        {"name": "DefaultPreemption", "args": {"minCandidateNodesAbsolute": 5.0}},
        {"name": "NodeResourcesFit", "args": {"scoringStrategy": {"type": "LeastAllocated", "resources": [{"name": "cpu", "weight": 3.0}]}}},
        {"name": "NodeAffinity", "args": {"addedAffinity": {PREFERRED: [{"weight": 5.0, "preference": term("In")}]}}}]),
    "standby caches": {"delayCacheUntilActive": False},
    "weights": plugins("score", {"name": "ImageLocality", "weight": 7}, {"name": "NodeAffinity"}),
    "everything disabled but one score": plugins("score", {"name": "TaintToleration"}, disabled=("*",)),
    "a plugin taken out": plugins("multiPoint", disabled=("PodTopologySpread",)),
    "upstream's queue sort": plugins("multiPoint", {"name": "PrioritySort"}),
    "plugins at every point they have": profile(plugins={
        "preEnqueue": {"enabled": [{"name": "DynamicResources"}, {"name": "DefaultPreemption"}]},
        "preFilter": {"enabled": [{"name": "NodeResourcesFit"}, {"name": "NodeName"}, {"name": "NodeUnschedulable"}]},
        "postFilter": {"enabled": [{"name": "DynamicResources"}]},
        "preScore": {"enabled": [{"name": "TaintToleration"}, {"name": "NodeResourcesBalancedAllocation"}], "disabled": [{"name": "*"}]},
        "score": {"enabled": [{"name": "DynamicResources", "weight": 3}]},
        "reserve": {"enabled": [{"name": "VolumeBinding"}]},
        "preBind": {"enabled": [{"name": "VolumeBinding"}, {"name": "DynamicResources"}]}}),
    "upstream's queue sort, named by one of two": {"profiles": [
        {"schedulerName": "a", "plugins": {"multiPoint": {"enabled": [{"name": "PrioritySort"}]}}}, {"schedulerName": "b"}]},
    "upstream's queue sort, at its point": plugins("queueSort", {"name": "PrioritySort"}),
    "upstream's binder": plugins("bind", {"name": "DefaultBinder"}, disabled=("*",)),
    "nothing but two plugins": plugins("multiPoint", {"name": "PrioritySort"}, {"name": "DefaultBinder"}, disabled=("*",)),
    "points for groups that say nothing": profile(plugins={"placementGenerate": {}, "placementScore": {}, "podGroupPostFilter": {}}),
    "fit, least": strategy(resources=[{"name": "cpu", "weight": 3}, {"name": "example.com/gpu", "weight": 100}]),
    "fit, no resources": strategy(resources=[]),
    "fit, most": strategy("MostAllocated"),
    "fit, weight left out": strategy(resources=[{"name": "cpu"}, {"name": "cpu", "weight": 0}]),
    "fit, ratio": ratio((0, 0), (50, 10), (100, 0)),
    "fit, ignored": args("NodeResourcesFit", ignoredResources=["example.com/a"], ignoredResourceGroups=["example.com"]),
    "balance": args("NodeResourcesBalancedAllocation", resources=[{"name": "cpu", "weight": 1}]),
    "balance, no resources": args("NodeResourcesBalancedAllocation", resources=[]),
    "added affinity": args("NodeAffinity", addedAffinity={REQUIRED: {"nodeSelectorTerms": [term("In")]}}),
    "added affinity, preferred": args("NodeAffinity", addedAffinity={PREFERRED: [{"weight": 5, "preference": term("NotIn")}]}),
    "affinity": args("InterPodAffinity", hardPodAffinityWeight=100, ignorePreferredTermsOfExistingPods=True),
    "spread, list": args("PodTopologySpread", defaultingType="List", defaultConstraints=[
        {"maxSkew": 1, "topologyKey": "rack", "whenUnsatisfiable": "ScheduleAnyway"}]),
    "spread, type left empty": args("PodTopologySpread", defaultingType=""),
    "volumes, no shape": args("VolumeBinding", shape=[]),
    "device time-outs as they are": args("DynamicResources", filterTimeout="10s", bindingTimeout="10m0s"),
    "device time-outs written otherwise": args("DynamicResources", filterTimeout="10000ms", bindingTimeout="600s"),
    "volumes": args("VolumeBinding", bindTimeoutSeconds=0, shape=[{"utilization": 0, "score": 0}, {"utilization": 100, "score": 10}]),
    "preemption": args("DefaultPreemption", minCandidateNodesPercentage=0, minCandidateNodesAbsolute=1),
}  # fmt: skip
"""Taken by kube-scheduler and by us."""

REFUSED: Final[dict[str, tuple[Json, str]]] = {
    "a field nobody knows": ({"profile": []}, 'unknown field "profile"'),
    "parallelism of none": ({"parallelism": 0}, "should be an integer value greater than zero"),
    "sampling above all": ({"percentageOfNodesToScore": 101}, "not in valid range [0-100]"),
    "no first back-off": ({"podInitialBackoffSeconds": 0}, "must be greater than 0"),
    "falling back-off": ({"podInitialBackoffSeconds": 3, "podMaxBackoffSeconds": 2}, "greater than or equal to PodInitialBackoffSeconds"),
    "another lock": ({"leaderElection": {"resourceLock": "endpoints"}}, 'resourceLock value must be "leases"'),
    "a lease too short": ({"leaderElection": {"leaseDuration": "1s"}}, "must be greater than `RenewDeadline`"),
    "negative burst": ({"clientConnection": {"burst": -1}}, "clientConnection.burst"),
    "a fraction": ({"parallelism": 5.5}, "parallelism"),
    "more than an integer holds": ({"parallelism": 2147483648.0}, "parallelism"),
    "a fraction in arguments": (args("DefaultPreemption", minCandidateNodesPercentage=5.5), "minCandidateNodesPercentage"),
    "a time below zero": ({"leaderElection": {"retryPeriod": "-1s"}}, 'leaderElection.retryPeriod: Invalid value: "-1s": must be greater than zero'),
    "no name where one stands": ({"profiles": [{"schedulerName": ""}]}, "profiles[0].schedulerName: Required value"),
    "one name twice": ({"profiles": [{"schedulerName": "a"}, {"schedulerName": "a"}]}, "Duplicate value"),
    "two profiles, one nameless": ({"profiles": [{"schedulerName": "a"}, {}]}, "profiles[1].schedulerName"),
    "a plugin nobody knows": (plugins("multiPoint", {"name": "NoSuchPlugin"}), "NoSuchPlugin"),
    "a plugin that is gone": (plugins("multiPoint", {"name": "EBSLimits"}), "EBSLimits"),
    "enabled twice": (plugins("score", {"name": "NodeAffinity"}, {"name": "NodeAffinity"}), "NodeAffinity"),
    "at a point it never had": (plugins("reserve", {"name": "NodeName"}), "NodeName"),
    "at the wrong point": (plugins("score", {"name": "NodeName"}), "NodeName"),
    "no bind plugin": (plugins("bind", disabled=("*",)), "bind"),
    "upstream's binder taken out": (plugins("multiPoint", disabled=("DefaultBinder",)), "at least one bind plugin is needed"),
    "upstream's queue sort taken out": (plugins("multiPoint", disabled=("PrioritySort",)), "only one queue sort plugin"),
    "two queue sorts": (plugins("queueSort", {"name": "PrioritySort"}, {"name": "ROSQueueSort"}), "only one queue sort plugin can be enabled"),
    "a weight below zero": (plugins("score", {"name": "ImageLocality", "weight": -3}), ""),
    "fit, no such strategy": (
        strategy("Random"),
        'scoringStrategy.type: Unsupported value: "Random": supported values: "LeastAllocated", "MostAllocated", "RequestedToCapacityRatio"'),
    "fit, no strategy": (args("NodeResourcesFit", scoringStrategy={}), 'scoringStrategy.type: Unsupported value: ""'),
    "fit, a shape for nothing": (
        strategy(requestedToCapacityRatio={"shape": []}),
        "scoringStrategy.requestedToCapacityRatio: Forbidden: must be nil when type is not RequestedToCapacityRatio"),
    "fit, ratio of nothing": (
        strategy("RequestedToCapacityRatio"),
        "scoringStrategy.requestedToCapacityRatio: Required value: must be specified when type is RequestedToCapacityRatio"),
    "fit, weight too large": (strategy(resources=[{"name": "cpu", "weight": 101}]), "resource weight of cpu not in valid range (0, 100]"),
    "fit, weight below zero": (strategy(resources=[{"name": "cpu", "weight": -1}]), "resource weight of cpu not in valid range (0, 100]"),
    "fit, no shape": (ratio(), "at least one point must be specified"),
    "fit, shape falling": (ratio((50, 1), (40, 2)), "increasing order"),
    "fit, shape too wide": (ratio((0, 1), (101, 2)), "utilization"),
    "fit, shape too high": (ratio((0, 11)), "score"),
    "fit, ignored name": (args("NodeResourcesFit", ignoredResources=["-bad-"]), 'ignoredResources[0]: Invalid value: "-bad-"'),
    "fit, ignored group, no name": (
        args("NodeResourcesFit", ignoredResourceGroups=["A_B!"]), 'ignoredResourceGroups[0]: Invalid value: "A_B!"'),
    "fit, ignored group": (args("NodeResourcesFit", ignoredResourceGroups=["a/b"]), "resource group name can't contain '/'"),
    "fit, a field nobody knows": (args("NodeResourcesFit", scoring={}), "scoring"),
    "balance, weight": (args("NodeResourcesBalancedAllocation", resources=[{"name": "cpu", "weight": 2}]), "Invalid value: 2: must be 1"),
    "balance, twice": (args("NodeResourcesBalancedAllocation", resources=[{"name": "cpu", "weight": 1}] * 2), 'Duplicate value: "cpu"'),
    "added affinity, operator": (
        args("NodeAffinity", addedAffinity={REQUIRED: {"nodeSelectorTerms": [term("Near")]}}),
        f'addedAffinity.{REQUIRED}.nodeSelectorTerms[0].matchExpressions[0].operator: Unsupported value: "Near"'),
    "affinity, weight": (args("InterPodAffinity", hardPodAffinityWeight=101), "not in valid range [0, 100]"),
    "spread, list without being asked": (
        args("PodTopologySpread", defaultConstraints=[{"maxSkew": 1, "topologyKey": "rack", "whenUnsatisfiable": "ScheduleAnyway"}]),
        "when .defaultConstraints are not empty"),
    "spread, selector": (
        args("PodTopologySpread", defaultingType="List", defaultConstraints=[
            {"maxSkew": 1, "topologyKey": "rack", "whenUnsatisfiable": "ScheduleAnyway", "labelSelector": {"matchLabels": {"a": "b"}}}]),
        "constraint must not define a selector, as they deduced for each pod"),
    "spread, no skew": (
        args("PodTopologySpread", defaultingType="List", defaultConstraints=[
            {"maxSkew": 0, "topologyKey": "rack", "whenUnsatisfiable": "ScheduleAnyway"}]),
        "maxSkew"),
    "spread, key": (
        args("PodTopologySpread", defaultingType="List", defaultConstraints=[
            {"maxSkew": 1, "topologyKey": "a b", "whenUnsatisfiable": "ScheduleAnyway"}]),
        'defaultConstraints[0].topologyKey: Invalid value: "a b"'),
    "volumes, time-out": (args("VolumeBinding", bindTimeoutSeconds=-1), "bindTimeoutSeconds"),
    "preemption, no candidates": (
        args("DefaultPreemption", minCandidateNodesPercentage=0, minCandidateNodesAbsolute=0), "cannot be zero at the same time as"),
    "preemption, share": (args("DefaultPreemption", minCandidateNodesPercentage=101), "not in valid range [0, 100]"),
    "preemption, number": (args("DefaultPreemption", minCandidateNodesAbsolute=-1), "not in valid range [0, inf)"),
}  # fmt: skip
"""Refused by kube-scheduler and by us, with the words both use (upstream's may have more around them)."""

OURS_ALONE: Final[dict[str, tuple[Json, str]]] = {
    "extenders": ({"extenders": [{"urlPrefix": "http://127.0.0.1:1"}]}, "extenders: not supported here"),
    "cold standby": ({"delayCacheUntilActive": True}, "delayCacheUntilActive: not supported here"),
    "gangs": (plugins("multiPoint", {"name": "GangScheduling"}), 'not supported here: plugin "GangScheduling"'),
    "a deadline a pause may miss": (
        {"leaderElection": {"renewDeadline": "2100ms", "retryPeriod": "2s"}}, "must be greater than 1.2 times `RetryPeriod`"),
    "devices": (args("DynamicResources", filterTimeout="20s"), "filterTimeout: only the default 10s is supported"),
}  # fmt: skip
"""kube-scheduler takes them, we refuse them with the reason."""
