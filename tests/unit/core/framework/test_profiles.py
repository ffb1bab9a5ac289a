from collections.abc import Mapping
from typing import Any

import pytest

from robotapp_scheduler.core.framework.profiles import (
    PluginRef,
    PluginSet,
    Profile,
    ProfileError,
    ProfileSpec,
    build_profiles,
)
from robotapp_scheduler.plugins.registry import catalogue


def build(
    plugins: Mapping[str, PluginSet] | None = None, args: Mapping[str, Mapping[str, Any]] | None = None
) -> Profile:
    spec = ProfileSpec("mine", plugins=plugins or {}, plugin_config=args or {})
    return build_profiles([spec], catalogue())["mine"]


def on(*names: str, weight: int = 0) -> PluginSet:
    return PluginSet(enabled=tuple(PluginRef(name, weight) for name in names))


def off(*names: str) -> PluginSet:
    return PluginSet(disabled=tuple(PluginRef(name) for name in names))


def test_the_default_order_and_weights_are_upstreams_followed_by_ours() -> None:
    profile = build()
    assert [plugin.name for plugin in profile.filters] == [
        "NodeName", "NodeUnschedulable", "TaintToleration", "NodeAffinity", "NodePorts", "NodeResourcesFit",
        "VolumeRestrictions", "NodeVolumeLimits", "VolumeBinding", "VolumeZone", "PodTopologySpread", "InterPodAffinity",
        "DynamicResources", "NodeDeclaredFeatures", "AllowedNamespaces", "HardwareAffinityFilter", "SharedDataFilter",
        "LatencyFilter", "ROSReserve",
    ]  # fmt: skip
    assert {plugin.name: plugin.weight for plugin in profile.scores} == {
        "TaintToleration": 3, "NodeAffinity": 2, "NodeResourcesFit": 1, "VolumeBinding": 1, "PodTopologySpread": 2,
        "InterPodAffinity": 2, "DynamicResources": 2, "NodeResourcesBalancedAllocation": 1, "ImageLocality": 1,
        "TopologyScore": 25, "LatencyScore": 5, "LoadBalanceScore": 3, "DeadlineScore": 8,
    }  # fmt: skip
    assert profile.queue_sort.name == "ROSQueueSort"


def test_a_plugin_can_be_replaced_in_place_and_weight_0_means_1() -> None:
    profile = build({"multiPoint": on("TaintToleration", weight=0)})
    assert [plugin.name for plugin in profile.filters][2] == "TaintToleration"
    assert {plugin.name: plugin.weight for plugin in profile.scores}["TaintToleration"] == 1


def test_a_point_can_switch_a_plugin_off_for_itself_only() -> None:
    profile = build({"score": off("TaintToleration")})
    assert "TaintToleration" not in [plugin.name for plugin in profile.scores]
    assert "TaintToleration" in [plugin.name for plugin in profile.filters]


def test_plugins_named_at_a_point_come_first_in_its_order() -> None:
    profile = build({"filter": on("NodeResourcesFit", "NodeName")})
    assert [plugin.name for plugin in profile.filters][:3] == ["NodeResourcesFit", "NodeName", "NodeUnschedulable"]


def test_the_weight_of_a_point_counts_and_is_1_where_it_is_left_out() -> None:
    profile = build({"multiPoint": on("NodeAffinity", weight=7), "score": on("NodeAffinity", "PodTopologySpread")})
    weights = {plugin.name: plugin.weight for plugin in profile.scores}
    assert (weights["NodeAffinity"], weights["PodTopologySpread"], weights["InterPodAffinity"]) == (1, 1, 2)


def test_what_a_point_disables_and_names_all_the_same_comes_last() -> None:
    both = PluginSet(enabled=on("NodeName", "NodePorts").enabled, disabled=off("NodeName").disabled)
    names = [plugin.name for plugin in build({"filter": both}).filters]
    assert (names[0], names[-1], names.count("NodeName")) == ("NodePorts", "NodeName", 1)


@pytest.mark.parametrize("point", ["multiPoint", "queueSort"])
def test_upstreams_queue_sort_takes_the_place_of_ours_where_it_is_named(point: str) -> None:
    profile = build({point: on("PrioritySort")})
    assert profile.queue_sort.name == "PrioritySort"
    assert "ROSBind" in profile.all


def test_who_takes_upstreams_default_out_means_ours() -> None:
    profile = build({"queueSort": PluginSet(enabled=on("ROSQueueSort").enabled, disabled=off("PrioritySort").disabled)})
    assert profile.queue_sort.name == "ROSQueueSort"
    with pytest.raises(ProfileError, match="only one queue sort plugin can be enabled, and one must be: none"):
        build({"multiPoint": off("PrioritySort")})


def test_a_star_removes_all_defaults() -> None:
    plugins = {"multiPoint": off("*"), "queueSort": on("PrioritySort"), "bind": on("ROSBind"), "filter": on("NodeName")}
    profile = build(plugins)
    assert [plugin.name for plugin in profile.filters] == ["NodeName"]
    assert profile.scores == ()
    assert not profile.uses_ros


@pytest.mark.parametrize(
    ("plugins", "args", "text"),
    [
        ({"multiPoint": on("Nope")}, {}, "unknown plugin 'Nope'"),
        ({"multiPoint": on("NodeName", "NodeName")}, {}, "plugin 'NodeName' is enabled twice"),
        ({"queueSort": on("PrioritySort", "ROSQueueSort")}, {}, "only one queue sort plugin can be enabled"),
        ({"multiPoint": off("ROSBind")}, {}, "at least one bind plugin"),
        ({"score": on("NodeName")}, {}, "does not take part at this point"),
        ({"sorting": on("NodeName")}, {}, "unknown extension point"),
        ({}, {"LatencyFilter": {"maxLatency": "fast"}}, "profiles[0].pluginConfig[LatencyFilter].args"),
        ({}, {"LatencyFilter": {"unknown": "Maybe"}}, "write Allow or Deny"),
        ({}, {"LatencyFilter": {"budget": 1}}, "unknown field `budget`"),
        ({}, {"LatencyScore": {"normalize": "Sum"}}, "write Budget or MinMax"),
        ({}, {"TopologyScore": {"masterNodeWeight": 101}}, "not in valid range [0-100]"),
        ({}, {"LoadBalanceScore": {"source": "Guess"}}, "write Requests or Telemetry"),
        ({}, {"ROSQueueSort": {"order": "Random"}}, "write Priority or Thesis"),
        ({}, {"ROSQueueSort": {"shadow": "yes"}}, "expected true or false"),
        ({}, {"NodeResourcesFit": {"scoringStrategy": {"type": "Most"}}}, 'supported values: "LeastAllocated"'),
        ({}, {"NodeResourcesBalancedAllocation": {"compatVersion": "1.0"}}, "allowed: 1.35, 1.37"),
        ({}, {"Stranger": {}}, "'Stranger' is not an enabled plugin"),
    ],
)
def test_a_wrong_configuration_names_the_path_and_what_is_allowed(
    plugins: dict[str, PluginSet], args: dict[str, dict[str, Any]], text: str
) -> None:
    with pytest.raises(ProfileError) as caught:
        build(plugins, args)
    assert text in str(caught.value)


def test_all_problems_are_reported_at_once_and_queue_sort_must_agree() -> None:
    ours = PluginSet(enabled=on("ROSQueueSort").enabled, disabled=off("PrioritySort").disabled)
    other = ProfileSpec("b", plugins={"queueSort": ours})
    with pytest.raises(ProfileError) as caught:
        build_profiles([ProfileSpec("a"), ProfileSpec("a"), other], catalogue())
    assert len(caught.value.problems) == 2
    assert "used twice" in caught.value.problems[0]
    assert "must be the same for all profiles" in caught.value.problems[1]


def test_the_hash_of_a_configuration_changes_with_its_arguments() -> None:
    assert build().config_hash == build().config_hash
    assert build().config_hash != build(args={"LatencyFilter": {"maxLatency": "50ms"}}).config_hash
