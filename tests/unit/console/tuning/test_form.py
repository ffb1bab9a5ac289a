"""From a configuration to fields and back: what a field changes, and that nothing else does."""

import copy

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.unit.console.tuning.documents import Document, build_document, build_text, disable, enable

from robotapp_console.tuning.check import check, find_field
from robotapp_console.tuning.edits import is_enabled
from robotapp_console.tuning.form import apply_form, build_form, fill_form, write_yaml
from robotapp_scheduler.config.editing import ArgumentKind, read_document
from robotapp_scheduler.plugins.registry import catalogue

STAND_INS = frozenset({"PrioritySort", "ROSQueueSort", "DefaultBinder", "ROSBind"})
"""A file that names one of Kubernetes' two gets them in place of ours, in all profiles: these toggles belong together."""
ROWS = [
    (group.point, row.name)
    for group in build_form(build_document())[0].points
    for row in group.rows
    if row.name not in STAND_INS
]
WEIGHED = [name for point, name in ROWS if point == "score"]
BASES = (
    build_document(),
    build_document(plugins={"score": enable(TopologyScore=10, LatencyScore=5)}),
    build_document(plugins={"multiPoint": {**enable("NodeName", TopologyScore=7), **disable("*")}}),
    build_document(
        plugins={"multiPoint": disable("LatencyFilter", "ImageLocality"), "filter": enable("LatencyFilter")}
    ),
    build_document(pluginConfig=[{"name": "LatencyFilter", "args": {"maxLatency": "80ms", "cacheTTL": "30s"}}]),
)


def toggle(fields: dict[str, str], row: str, *, on: bool) -> dict[str, str]:
    return {**fields, row: "on"} if on else {name: value for name, value in fields.items() if name != row}


def change(document: Document, **changes: str | None) -> Document:
    """Returns what the form with these fields means; None is a toggle that is switched off."""
    fields = fill_form(build_form(document))
    for name, value in changes.items():
        field = name.replace("__", "-")
        fields = toggle(fields, field, on=False) if value is None else {**fields, field: value}
    edited, problems = apply_form(document, fields)
    assert not problems
    return edited


@pytest.mark.parametrize("document", BASES, ids=range(len(BASES)))
def test_an_untouched_form_means_the_same_document(document: Document) -> None:
    before = copy.deepcopy(document)
    edited, problems = apply_form(document, fill_form(build_form(document)))
    assert (edited, problems) == (before, {})
    assert document == before


@pytest.mark.parametrize(("point", "name"), ROWS, ids=str)
def test_each_plugin_can_be_switched_off_at_one_point_and_on_again(point: str, name: str) -> None:
    document = build_document()
    row = f"p0-{point}-{name}"
    fields = fill_form(build_form(document))
    off, _ = apply_form(document, toggle(fields, row, on=False))
    assert not is_enabled(off, 0, point, name)
    assert is_enabled(off, 1, point, name), "the other profile is as it was"
    changed = {
        (group.point, plugin.name)
        for group in build_form(off)[0].points
        for plugin in group.rows
        if plugin.on != (plugin.id in fields)
    }
    assert changed == {(point, name)}, "other points are as they were"
    on, _ = apply_form(off, toggle(fill_form(build_form(off)), row, on=True))
    assert on == document


@pytest.mark.parametrize("name", ["ROSQueueSort", "ROSBind"])
def test_a_plugin_without_which_nothing_is_placed_is_refused_by_the_loader_at_its_point(name: str) -> None:
    point = "queueSort" if name == "ROSQueueSort" else "bind"
    edited = change(build_document(), **{f"p0__{point}__{name}": None})
    fields = {problem.field for problem in check(edited).problems}
    assert f"p0-{point}" in fields


@st.composite
def filled_forms(draw: st.DrawFn) -> tuple[Document, dict[str, str]]:
    document = copy.deepcopy(draw(st.sampled_from(BASES)))
    fields = fill_form(build_form(document))
    for point, name in draw(st.lists(st.sampled_from(ROWS), max_size=8)):
        fields = toggle(fields, f"p{draw(st.integers(0, 1))}-{point}-{name}", on=draw(st.booleans()))
    for name in draw(st.lists(st.sampled_from(WEIGHED), max_size=5)):
        fields[f"p{draw(st.integers(0, 1))}-weight-{name}"] = str(draw(st.integers(1, 1000)))
    return document, fields


@settings(max_examples=120, deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])
@given(filled_forms())
def test_form_to_yaml_to_form_gives_what_was_entered(example: tuple[Document, dict[str, str]]) -> None:
    document, fields = example
    edited, problems = apply_form(document, fields)
    assert not problems
    read = read_document(write_yaml(edited))
    assert read == edited
    result = fill_form(build_form(read))
    for profile in build_form(document):
        for group in profile.points:
            for row in group.rows:
                assert (row.id in result) == (row.id in fields), row.id
                if row.weight_id and row.id in fields:
                    assert result[row.weight_id] == fields[row.weight_id], row.weight_id
    again, _ = apply_form(edited, result)
    assert again == edited, "a second time nothing changes"


def test_a_weight_is_written_where_the_file_names_the_plugin() -> None:
    at_score = change(BASES[1], p0__weight__LatencyScore="9")
    assert at_score["profiles"][0]["plugins"]["score"]["enabled"][1] == {"name": "LatencyScore", "weight": 9}
    at_all = change(BASES[2], p0__weight__TopologyScore="9")
    assert at_all["profiles"][0]["plugins"]["multiPoint"]["enabled"][1] == {"name": "TopologyScore", "weight": 9}
    assert change(BASES[0], p1__weight__DeadlineScore="9")["profiles"][1]["plugins"] == {
        "score": {"enabled": [{"name": "DeadlineScore", "weight": 9}]}
    }


@pytest.mark.parametrize("text", ["", "0", "-1", "1.5", "many", "\uff12", "9" * 400, "2147483648"])
def test_what_is_no_weight_is_a_mistake_at_its_field(text: str) -> None:
    document = build_document()
    fields = fill_form(build_form(document)) | {"p0-weight-TopologyScore": text}
    edited, problems = apply_form(document, fields)
    assert list(problems) == ["p0-weight-TopologyScore"]
    assert problems["p0-weight-TopologyScore"].startswith("Weight of TopologyScore: write a whole number from 1 to")
    assert edited == document


def test_every_argument_of_the_thesis_is_a_field_of_its_kind() -> None:
    fields = {
        (plugin.plugin, field.name): field
        for plugin in build_form(build_document())[0].arguments
        for field in plugin.fields
    }
    assert fields["LatencyFilter", "maxLatency"].kind is ArgumentKind.TEXT
    assert fields["LatencyFilter", "maxLatency"].default == "100ms"
    assert fields["LatencyFilter", "outlierFactor"].kind is ArgumentKind.NUMBER
    assert "agents measure" in fields["LatencyFilter", "cacheTTL"].ignored
    assert fields["LatencyFilter", "unknown"].choices == ("Allow", "Deny")
    assert fields["TopologyScore", "masterNodeWeight"].kind is ArgumentKind.INTEGER
    assert fields["NodeResourcesFit", "scoringStrategy"].kind is ArgumentKind.VALUE
    assert fields["LatencyScore", "shadow"].kind is ArgumentKind.SWITCH


def test_every_built_in_argument_can_be_read_and_written() -> None:
    for name, plugin in catalogue().classes.items():
        document = build_document(pluginConfig=[{"name": name}])
        if not check(document).problems:
            assert fill_form(build_form(document)) is not None, plugin


def test_arguments_are_written_with_their_type_and_an_empty_one_is_the_default() -> None:
    edited = change(
        build_document(),
        p0__arg__LatencyFilter__maxLatency="50ms",
        p0__arg__LatencyFilter__outlierFactor="2.5",
        p0__arg__LatencyFilter__unknown="Deny",
        p0__arg__TopologyScore__masterNodeWeight="60",
        p0__arg__LatencyScore__shadow="true",
        p0__arg__NodeResourcesFit__scoringStrategy="type: MostAllocated",
    )
    assert {entry["name"]: entry["args"] for entry in edited["profiles"][0]["pluginConfig"]} == {
        "LatencyFilter": {"maxLatency": "50ms", "unknown": "Deny", "outlierFactor": 2.5},
        "TopologyScore": {"masterNodeWeight": 60},
        "LatencyScore": {"shadow": True},
        "NodeResourcesFit": {"scoringStrategy": {"type": "MostAllocated"}},
    }
    emptied = change(edited, p0__arg__LatencyFilter__maxLatency="", p0__arg__TopologyScore__masterNodeWeight="")
    names = {entry["name"]: entry["args"] for entry in emptied["profiles"][0]["pluginConfig"]}
    assert "maxLatency" not in names["LatencyFilter"]
    assert "TopologyScore" not in names


@pytest.mark.parametrize(
    ("argument", "text"),
    [
        ("TopologyScore-masterNodeWeight", "much"),
        ("TopologyScore-masterNodeWeight", "1" * 30),
        ("LatencyFilter-outlierFactor", "inf"),
        ("LatencyFilter-outlierFactor", "NaN"),
        ("NodeResourcesFit-scoringStrategy", "{a: b: c"),
    ],
)
def test_what_does_not_fit_the_type_is_a_mistake_at_its_field(argument: str, text: str) -> None:
    document = build_document()
    fields = fill_form(build_form(document)) | {f"p0-arg-{argument}": text}
    _, problems = apply_form(document, fields)
    assert list(problems) == [f"p0-arg-{argument}"]


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"p0__arg__LatencyFilter__maxLatency": "soon"}, "p0-arg-LatencyFilter-maxLatency"),
        ({"p1__arg__LatencyFilter__outlierFactor": "-1"}, "p1-arg-LatencyFilter-outlierFactor"),
        ({"p0__arg__TopologyScore__masterNodeWeight": "101"}, "p0-arg-TopologyScore-masterNodeWeight"),
        ({"p0__arg__ROSQueueSort__agingSeconds": "-5"}, "p0-arg-ROSQueueSort-agingSeconds"),
        ({"p0__arg__NodeResourcesFit__scoringStrategy": "[]"}, "p0-arg-NodeResourcesFit-scoringStrategy"),
        ({"p0__arg__ROSBind__shadow": "true"}, "p0-arg-ROSBind-shadow"),
        ({"p0__bind__ROSBind": None}, "p0-bind"),
    ],
)
def test_each_mistake_of_the_loader_is_at_its_field(changes: dict[str, str | None], field: str) -> None:
    edited = change(build_document(), **changes)
    problems = check(edited).problems
    assert field in {problem.field for problem in problems}, problems


def test_mistakes_in_lists_are_at_the_plugin_that_they_name() -> None:
    document = build_document()
    document["profiles"][0]["plugins"] = {"score": {"enabled": [{"name": "NoSuchScore", "weight": -3}]}}
    assert find_field("profiles[0].plugins.score.enabled[0].weight: Invalid value", document) == "p0-weight-NoSuchScore"
    assert find_field("profiles[0].plugins.score.enabled[0].name: x", document) == "p0-score-NoSuchScore"
    assert find_field("profiles[1].schedulerName: Required value", document) == "p1"
    assert find_field("leaderElection.leaseDuration: x", document) == ""
    for text in ("profiles[7].plugins.score.enabled[9].name: x", "profiles[7].pluginConfig[0].args: x", ""):
        find_field(text, document)


def test_a_plugin_that_only_the_scheduler_can_load_is_kept_and_said_to_be_unchecked() -> None:
    name = "mylab.quiet:QuietNodes"
    document = build_document(
        plugins={"multiPoint": enable(name)}, pluginConfig=[{"name": name, "args": {"most": 3, "shadow": True}}]
    )
    verdict = check(document)
    assert not verdict.problems
    assert any(name in warning for warning in verdict.warnings)
    edited = change(document, p0__weight__TopologyScore="2")
    assert edited["profiles"][0]["pluginConfig"] == [{"name": name, "args": {"most": 3, "shadow": True}}]


def test_a_text_names_no_module_that_the_console_would_import() -> None:
    document = build_document(plugins={"multiPoint": enable("antigravity:fly", "this:that")})
    check(document)
    import sys

    assert not {"antigravity", "this"} & sys.modules.keys()


def test_a_file_without_profiles_has_the_one_that_counts() -> None:
    document = read_document("apiVersion: kubescheduler.config.k8s.io/v1\nkind: KubeSchedulerConfiguration\n")
    edited, _ = apply_form(document, fill_form(build_form(document)))
    assert edited == document
    assert len(change(document, p0__weight__TopologyScore="2")["profiles"]) == 1


def test_the_text_of_a_document_reads_as_the_document() -> None:
    for document in BASES:
        assert read_document(write_yaml(document)) == document
    assert read_document(build_text()) == build_document()
