import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotapp_scheduler.config_model import PluginRef, Plugins, PluginSet
from robotapp_scheduler.config_plugins import DuplicatePluginError, PluginUse, effective, merge, spread

POINTS_OF = {
    "A": frozenset({"filter", "score"}),
    "B": frozenset({"filter"}),
    "C": frozenset({"score"}),
    "D": frozenset({"filter", "score"}),
}


def refs(*names: str, **weights: int) -> list[PluginRef]:
    return [PluginRef(name=name, weight=weights.get(name, 0)) for name in names]


def points_of(name: str) -> frozenset[str]:
    return POINTS_OF.get(name, frozenset())


def names(uses: tuple[PluginUse, ...]) -> list[str]:
    return [use.name for use in uses]


def lists(custom: Plugins) -> dict[str, tuple[PluginUse, ...]]:
    return effective(refs("A", "B", "C", A=3), custom, points_of=points_of)


def test_without_a_profile_list_every_plugin_runs_at_each_point_it_implements() -> None:
    found = lists(Plugins())
    assert names(found["filter"]) == ["A", "B"]
    assert names(found["score"]) == ["A", "C"]
    assert found["score"][0].weight == 3


def test_a_plugin_of_the_same_name_replaces_the_default_in_place() -> None:
    found = lists(Plugins(multi_point=PluginSet(enabled=refs("D", "A", A=7))))
    assert names(found["score"]) == ["A", "C", "D"]
    assert found["score"][0].weight == 7


def test_disabled_star_in_multi_point_removes_all_defaults() -> None:
    found = lists(Plugins(multi_point=PluginSet(disabled=refs("*"), enabled=refs("D"))))
    assert names(found["filter"]) == names(found["score"]) == ["D"]


def test_a_plugin_can_be_disabled_at_one_point_only() -> None:
    found = lists(Plugins(score=PluginSet(disabled=refs("A"))))
    assert names(found["score"]) == ["C"]
    assert names(found["filter"]) == ["A", "B"]


def test_disabled_star_at_a_point_keeps_only_what_the_point_names() -> None:
    found = lists(Plugins(score=PluginSet(disabled=refs("*"), enabled=refs("D"))))
    assert names(found["score"]) == ["D"]


def test_plugins_named_in_both_places_come_first_in_the_order_of_the_point() -> None:
    found = lists(Plugins(score=PluginSet(enabled=refs("D", "C", "A", A=9))))
    assert names(found["score"]) == ["C", "A", "D"]
    assert found["score"][1].weight == 9


def test_weight_zero_means_one() -> None:
    assert spread(PluginSet(enabled=refs("A")), PluginSet(), implements=lambda _: True) == (PluginUse("A", 1),)


def test_a_plugin_named_twice_in_one_list_is_refused() -> None:
    with pytest.raises(DuplicatePluginError, match="D"):
        lists(Plugins(score=PluginSet(enabled=refs("D", "D"))))
    with pytest.raises(DuplicatePluginError, match="D"):
        lists(Plugins(multi_point=PluginSet(enabled=refs("D", "D"))))


plugin_lists = st.lists(st.sampled_from("ABCD"), unique=True).map(lambda found: refs(*found))
disabled_lists = st.lists(st.sampled_from("ABCD*"), unique=True).map(lambda found: refs(*found))
sets = st.builds(PluginSet, enabled=plugin_lists, disabled=disabled_lists)


@given(defaults=plugin_lists, custom=sets)
def test_merging_keeps_every_wanted_plugin_once_and_no_default_that_was_disabled(
    defaults: list[PluginRef], custom: PluginSet
) -> None:
    merged = [ref.name for ref in merge(PluginSet(enabled=defaults), custom).enabled]
    wanted = {ref.name for ref in custom.enabled}
    disabled = {ref.name for ref in custom.disabled}
    kept = set() if "*" in disabled else {ref.name for ref in defaults} - disabled
    assert len(merged) == len(set(merged))
    assert set(merged) == wanted | kept


@given(point=sets, multi=plugin_lists)
def test_spreading_keeps_every_plugin_named_at_the_point_exactly_once(point: PluginSet, multi: list[PluginRef]) -> None:
    found = names(spread(point, PluginSet(enabled=multi), implements=lambda _: True))
    assert len(found) == len(set(found))
    assert {ref.name for ref in point.enabled} <= set(found)
    off = {ref.name for ref in point.disabled}
    expected = set() if "*" in off else {ref.name for ref in multi} - off
    assert set(found) == expected | {ref.name for ref in point.enabled}
