"""`x-robotapp` in a compose file: fields of RobotApp that compose has no words for."""

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from tests.unit.cli.importing.compose import (
    find_lines,
    get_component,
    get_spec,
    get_verdict,
    import_files,
    import_one,
    import_services,
)

from robotapp_cli.importing.report import ComposeError, Verdict

KEYS = st.sampled_from(["qosClass", "policies", "a", "b"])
VALUES = st.recursive(
    st.one_of(st.text("xyz", min_size=1), st.integers(0, 9), st.booleans()),
    lambda inner: st.one_of(st.lists(inner, max_size=2), st.dictionaries(KEYS, inner, max_size=2)),
    max_leaves=5,
)


def test_fields_of_a_service_are_laid_over_its_component() -> None:
    result = import_one({"command": ["a", "b"], "x-robotapp": {"runsOn": ["Robot"], "policies": {"deadline": "50ms"}}})
    component = get_component(result)
    assert component == {
        "name": "driver",
        "image": "ros:jazzy",
        "args": ["a", "b"],
        "runsOn": ["Robot"],
        "policies": {"deadline": "50ms"},
    }
    assert get_verdict(result, "services.driver.x-robotapp") is Verdict.TAKEN


def test_mappings_are_merged_lists_are_replaced_and_null_removes() -> None:
    service = {
        "environment": {"A": "1"},
        "group_add": ["20"],
        "devices": ["/dev/ttyUSB0:/dev/lidar"],
        "x-robotapp": {
            "devices": [{"name": "lidar", "type": "serial"}],
            "template": {"spec": {"securityContext": {"fsGroup": 5, "supplementalGroups": None}}},
        },
    }
    component = get_component(import_one(service))
    assert component["env"] == [{"name": "A", "value": "1"}]
    assert component["devices"] == [{"name": "lidar", "type": "serial"}]
    assert component["template"]["spec"]["securityContext"] == {"fsGroup": 5}


def test_fields_at_the_top_are_laid_over_the_spec() -> None:
    top = {"x-robotapp": {"robots": {"count": 2}, "ros": {"distro": "kilted"}}}
    result = import_services({"driver": {"image": "ros:jazzy"}}, top=top)
    assert get_spec(result)["robots"] == {"count": 2}
    assert get_spec(result)["ros"] == {"distro": "kilted"}
    assert get_verdict(result, "x-robotapp") is Verdict.TAKEN


def test_of_two_files_the_later_one_wins_field_by_field() -> None:
    first = {"services": {"driver": {"image": "ros:jazzy"}}, "x-robotapp": {"gang": "All", "schedulerName": "a"}}
    second = {"x-robotapp": {"schedulerName": "b"}}
    files = {"one.yaml": yaml.safe_dump(first), "two.yaml": yaml.safe_dump(second)}
    spec = get_spec(import_files(files, names=[*files]))
    assert (spec["gang"], spec["schedulerName"]) == ("All", "b")


def test_a_variable_has_its_value_there_too() -> None:
    service = {"x-robotapp": {"policies": {"deadline": "${DEADLINE}"}}}
    assert get_component(import_one(service, variables={"DEADLINE": "50ms"}))["policies"] == {"deadline": "50ms"}
    with pytest.raises(ComposeError, match=r"a value is needed here .DEADLINE has no value; give --env"):
        import_one(service)


@pytest.mark.parametrize(
    ("services", "top", "message"),
    [
        ({"x-robotapp": {"name": "other"}}, {}, "the component has the name of the service; rename the service"),
        ({}, {"x-robotapp": {"components": []}}, "write its fields under x-robotapp of the service"),
        ({"x-robotapp": ["runsOn"]}, {}, "a mapping is needed here"),
        ({}, {"x-robotapp": "runsOn"}, "a mapping is needed here"),
    ],
)
def test_what_has_another_place_is_refused_with_that_place(
    services: dict[str, object], top: dict[str, object], message: str
) -> None:
    with pytest.raises(ComposeError, match=message):
        import_one(services, top=top)


def test_other_extensions_are_left_out_as_before() -> None:
    result = import_one({"x-note": 1}, top={"x-common": {"a": 1}})
    assert {get_verdict(result, path) for path in ("services.driver.x-note", "x-common")} == {Verdict.LEFT_OUT}


@given(st.dictionaries(KEYS, VALUES, min_size=1, max_size=3))
def test_whatever_is_written_arrives_and_has_one_line_in_the_report(fields: dict[str, object]) -> None:
    result = import_one({"x-robotapp": fields})
    component = get_component(result)
    assert {key: component[key] for key in fields} == fields
    assert len(find_lines(result, "services.driver.x-robotapp")) == 1
