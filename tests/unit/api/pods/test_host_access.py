"""Fields that reach the node: found in every container and pod, refused by an operator that is not to render them, told where ROS changes."""

from typing import Any

import pytest
from tests.live.attacks.table.host_access import BAD, app_with_everything_free, honest_app, places_of, written
from tests.support.factories import component

from robotapp_api.checks.host_access.guarded import find_guarded, find_rights, host_access_problems
from robotapp_api.checks.host_access.table import GUARDED, GuardedField, HostRight
from robotapp_api.checks.spec import spec_notes, spec_problems
from robotapp_api.model.app.robotapp import RobotAppSpec
from robotapp_api.model.names import Reason
from robotapp_api.schema.host_policy import policy_variables

CASES = [(field, kind) for field in GUARDED for kind in places_of(field)]
ALL_OF_A_KIND = len(CASES)


def parse(app: dict[str, Any]) -> RobotAppSpec:
    return RobotAppSpec.model_validate(app["spec"])


def spec_of(*components: dict[str, Any], **fields: Any) -> RobotAppSpec:
    return RobotAppSpec.model_validate({"ros": {"distro": "jazzy"}, "components": list(components), **fields})


def hosted(name: str, **pod: Any) -> dict[str, Any]:
    return component(name, template={"spec": {"hostNetwork": True, **pod}})


@pytest.mark.parametrize(("field", "kind"), CASES, ids=lambda part: getattr(part, "path", part))
def test_a_guarded_field_is_found_where_it_stands(field: GuardedField, kind: str) -> None:
    spec = parse(written(field, places_of(field)[kind], BAD[field.path]))
    (use,) = find_guarded(spec)
    assert use.field is field
    assert (
        places_of(field)[kind].removesuffix(".template.metadata.annotations").removesuffix(".template.spec") in use.at
    )
    (problem,) = host_access_problems(spec)
    assert problem.reason is Reason.HOST_ACCESS_OFF
    assert field.effect in problem.message
    assert "--host-access" in problem.message


def test_every_guarded_field_has_a_bad_value_and_every_right_a_field() -> None:
    assert BAD.keys() == {field.path for field in GUARDED}
    assert {field.right for field in GUARDED} == {*HostRight}
    assert ALL_OF_A_KIND > 120


def test_free_values_and_absence_take_no_right() -> None:
    assert find_rights(parse(app_with_everything_free())) == {}
    assert find_rights(parse(honest_app())) == {}


@pytest.mark.parametrize("value", ["", "runtime/default", "localhost/robot"])
def test_a_profile_of_the_node_by_annotation_takes_no_right(value: str) -> None:
    (field,) = (each for each in GUARDED if each.level.value == "annotations")
    assert find_rights(parse(written(field, places_of(field)["component"], value))) == {}


def test_one_problem_is_told_per_right() -> None:
    spec = spec_of(
        component(
            "a",
            securityContext={"privileged": True, "capabilities": {"add": ["SYS_ADMIN"]}},
            template={"spec": {"hostNetwork": True}},
        ),
        component("b", securityContext={"privileged": True}),
    )
    assert [problem.field for problem in host_access_problems(spec)] == [
        "spec.components[0].template.spec.hostNetwork",
        "spec.components[0].securityContext.privileged",
    ]


def test_the_policy_has_a_variable_for_every_field_and_a_sentence_for_every_right() -> None:
    variables = {variable["name"]: variable["expression"] for variable in policy_variables()}
    sets = {field.free for field in GUARDED if len(field.free) > 1}
    assert len(variables) == len(policy_variables()) == 1 + len(sets) + len(GUARDED) + len(HostRight)
    for right in HostRight:
        sentence = variables[right.value]
        for field in GUARDED:
            assert (f"{field.effect} ({field.name})" in sentence) is (field.right is right)


def notes(spec: RobotAppSpec) -> list[str]:
    return [note.message for note in spec_notes(spec) if "hostNetwork" in note.field or "hostname" in note.field]


def test_fast_dds_in_the_network_of_a_node_is_said_to_use_udp_unless_it_shares_memory_there() -> None:
    assert any("UDP alone" in text for text in notes(spec_of(hosted("a"), component("b"))))
    assert not any("UDP alone" in text for text in notes(spec_of(hosted("a", hostIPC=True), component("b"))))
    cyclone = {"ros2": {"rmw": "rmw_cyclonedds_cpp"}}
    assert not any("UDP alone" in text for text in notes(spec_of(hosted("a"), component("b"), **cyclone)))


def test_multicast_in_the_network_of_a_node_is_said_to_reach_everybody_there() -> None:
    spec = spec_of(hosted("a"), component("b"), ros2={"discovery": {"mode": "Multicast"}})
    assert any("meets every program on the network of its node" in text for text in notes(spec))
    assert not any("meets every program" in text for text in notes(spec_of(hosted("a"), component("b"))))


@pytest.mark.parametrize(("rmw", "processes"), [("rmw_cyclonedds_cpp", "33"), ("rmw_fastrtps_cpp", "120")])
def test_several_components_in_the_network_of_a_node_are_told_how_many_processes_have_room(
    rmw: str, processes: str
) -> None:
    text = " ".join(notes(spec_of(hosted("a"), hosted("b"), ros2={"rmw": rmw})))
    assert f"{processes} of them have room" in text
    assert "have room" not in " ".join(notes(spec_of(hosted("a"), component("b"), ros2={"rmw": rmw})))


def test_components_that_share_the_loopback_of_a_node_may_talk_by_it() -> None:
    edge = {"topic": "/t", "from": "a", "to": "b"}
    localhost = {"ros2": {"discovery": {"mode": "Localhost"}}, "edges": [edge]}
    together = {**hosted("b"), "colocateWith": ["a"]}
    assert not any(
        "Localhost" in str(problem) for problem in spec_problems(spec_of(hosted("a"), together, **localhost))
    )
    assert any("Localhost" in str(problem) for problem in spec_problems(spec_of(hosted("a"), hosted("b"), **localhost)))
    assert any("every program on its node" in text for text in notes(spec_of(hosted("a"), together, **localhost)))


def test_fields_that_contradict_access_to_the_node_are_refused() -> None:
    both = component("a", sharedMemory={"size": "1Gi"}, template={"spec": {"hostIPC": True}})
    assert "remove sharedMemory" in " ".join(map(str, spec_problems(spec_of(both))))
    pids = component("a", template={"spec": {"hostPID": True, "shareProcessNamespace": True}})
    assert "remove one of the two" in " ".join(map(str, spec_problems(spec_of(pids))))
    peers = spec_of(
        component("a", template={"spec": {"hostname": "x"}}), component("b"), ros2={"rmw": "rmw_cyclonedds_cpp"}
    )
    assert "the host name is the component's" in " ".join(map(str, spec_problems(peers)))
    assert "has no effect with hostNetwork" in " ".join(notes(spec_of(hosted("a", hostname="a"))))
