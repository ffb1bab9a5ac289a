"""What admission cannot decide: each refusal names the field and what to write instead."""

from collections.abc import Mapping
from typing import Any

import pytest
from tests.support.claims.objects import domain_claim
from tests.support.factories import by_name, component, make_app, make_node, robots

from robotapp_api.model.names import Annotation, Reason
from robotapp_claims.rules.objects import Pool, PoolMeta, PoolSpec
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.plan.spec.objects import Node
from robotapp_operator.plan.spec.validate import (
    Problem,
    domain_problems,
    name_problems,
    notes_of,
    override_notes,
    problems_alone,
    problems_with,
    secret_notes,
)

EACH = {"nodeSelector": {"matchExpressions": [{"key": "robotics.io/robot", "operator": "Exists"}]}}
ROBOTS = {"nodeSelector": {"matchLabels": {"robotics.io/robot": "amr-07"}}}


def problems_of(app: App, nodes: Mapping[str, Node]) -> tuple[Problem, ...]:
    return (*problems_alone(app), *problems_with(app, nodes))


def only_problem(app: App, **nodes: object) -> tuple[str, str, str]:
    (problem,) = problems_of(app, nodes or robots("amr-07"))  # type: ignore[arg-type]
    return problem.reason, problem.field, problem.message


def test_a_plain_app_is_accepted() -> None:
    assert problems_of(make_app(), {}) == ()


def test_an_unknown_distro_is_refused_with_the_nearest_one() -> None:
    reason, field, message = only_problem(make_app(ros={"distro": "humbel"}))
    assert (reason, field) == (Reason.UNKNOWN_DISTRO, "spec.ros.distro")
    assert 'did you mean "humble"?' in message


def test_a_distro_unlike_any_other_is_answered_with_the_list() -> None:
    assert "known are" in only_problem(make_app(ros={"distro": "qqqq"}))[2]


@pytest.mark.parametrize(
    ("spec", "field", "says"),
    [
        ({"ros": {"distro": "noetic", "version": 2}}, "spec.ros.version", "ROS 1 distribution; write version: 1"),
        ({"ros": {"distro": "noetic"}, "ros2": {}}, "spec.ros2", "remove spec.ros2"),
        ({"ros1": {"master": "Managed"}}, "spec.ros1", "remove spec.ros1"),
        ({"ros": {"distro": "noetic"}, "ros1": {"master": "External"}}, "spec.ros1.uri", "http://"),
        (
            {"ros2": {"rmw": "rmw_cyclonedds_cpp", "discovery": {"mode": "Server"}}},
            "spec.ros2.discovery.mode",
            "Fast DDS only",
        ),
        ({"ros2": {"discovery": {"mode": "Router"}}}, "spec.ros2.discovery.mode", "rmw_zenoh_cpp only"),
        (
            {"ros2": {"rmw": "rmw_zenoh_cpp", "discovery": {"mode": "Multicast"}}},
            "spec.ros2.discovery.mode",
            "Auto or Router",
        ),
        ({"ros2": {"discovery": {"mode": "Peers"}}}, "spec.ros2.discovery.mode", "came with Iron"),
        ({"placement": {"masterNode": "ghost"}}, "spec.placement.masterNode", 'no node "ghost"'),
        (
            {"edges": [{"topic": "/t", "from": "operator", "to": "nobody"}]},
            "spec.edges[0].to",
            '"nobody" is no component',
        ),
    ],
)
def test_contradictions_of_the_spec_are_refused(spec: dict[str, object], field: str, says: str) -> None:
    reason, at, message = only_problem(make_app(**spec))
    assert (reason, at) == (Reason.INVALID_SPEC, field)
    assert says in message


def test_fast_dds_takes_peers_from_iron_on() -> None:
    assert problems_of(make_app(ros={"distro": "jazzy"}, ros2={"discovery": {"mode": "Peers"}}), {}) == ()


def test_localhost_discovery_is_refused_between_components_but_not_alone() -> None:
    alone = make_app(component("solo"), ros2={"discovery": {"mode": "Localhost"}})
    assert problems_of(alone, {}) == ()
    edge = {"topic": "/cmd_vel", "from": "operator", "to": "driver"}
    pair = make_app(ros2={"discovery": {"mode": "Localhost"}}, edges=[edge])
    assert "keeps operator and driver apart" in only_problem(pair)[2]


@pytest.mark.parametrize("variable", ["ROS_DOMAIN_ID", "RMW_IMPLEMENTATION", "ROS_MASTER_URI"])
def test_variables_that_belong_to_the_app_are_refused_on_one_component(variable: str) -> None:
    app = make_app(component("a"), component("b", env=[{"name": variable, "value": "1"}]))
    _, field, message = only_problem(app)
    assert field == "spec.components[1].env"
    assert f"{variable} of b" in message


@pytest.mark.parametrize("resource", ["nvidia.com/gpu", "hugepages-2Mi"])
def test_what_cannot_be_shared_needs_a_limit(resource: str) -> None:
    asked = {"requests": {"cpu": "1", resource: "1"}}
    _, field, message = only_problem(make_app(component("a"), component("b", resources=asked)))
    assert field == f'spec.components[1].resources.requests["{resource}"]'
    assert "write it under limits" in message
    assert problems_of(make_app(component("b", resources={**asked, "limits": {resource: "1"}})), {}) == ()


def test_parameters_need_a_command_line_they_can_be_appended_to() -> None:
    bare = make_app(component("a", parameters=[{"configMapKeyRef": {"name": "c", "key": "k.yaml"}}]))
    assert "write command or args of a" in only_problem(bare)[2]
    assert (
        problems_of(
            make_app(component("a", args=["run"], parameters=[{"configMapKeyRef": {"name": "c", "key": "k.yaml"}}])), {}
        )
        == ()
    )


def test_ros_1_has_no_parameter_files() -> None:
    app = make_app(
        component("a", args=["run"], parameters=[{"configMapKeyRef": {"name": "c", "key": "k.yaml"}}]),
        ros={"distro": "noetic"},
    )
    assert "rosparam" in only_problem(app)[2]


def test_colocation_is_transitive_so_a_chain_can_contradict_separation() -> None:
    app = make_app(
        component("a", colocateWith=["b"]), component("b", colocateWith=["c"]), component("c", separateFrom=["a"])
    )
    _, field, message = only_problem(app)
    assert field == "spec.components[2].separateFrom"
    assert "c must be apart from a" in message


def test_separate_groups_are_no_contradiction() -> None:
    app = make_app(component("a", colocateWith=["b"]), component("b"), component("c", separateFrom=["a"]))
    assert problems_of(app, {}) == ()


def test_a_name_in_colocate_with_must_be_a_component() -> None:
    assert '"ghost" is no component' in only_problem(make_app(component("a", colocateWith=["ghost"])))[2]


def test_a_selector_without_robots_lists_the_robots_there_are() -> None:
    app = make_app(robots={"nodeSelector": {"matchLabels": {"robotics.io/robot": "amr-99"}}})
    (problem,) = problems_of(app, robots("amr-07", "amr-08"))
    assert problem.reason == Reason.NO_MATCHING_ROBOT
    assert "robots that admit namespace default are amr-07, amr-08" in problem.message
    assert "no robot admits namespace default" in problems_of(app, {})[0].message


TEAMS = {Annotation.ALLOWED_NAMESPACES: "team-a, team-b"}


def test_a_robot_that_admits_other_namespaces_only_is_refused_without_their_names() -> None:
    node = make_node("n", robot="amr-07", annotations=TEAMS)
    (problem,) = problems_of(make_app(robots=ROBOTS), by_name([node]))
    assert problem.reason == Reason.NO_MATCHING_ROBOT
    assert "admits namespace default" in problem.message
    assert "robotics.io/allowed-namespaces" in problem.message
    assert not any(name in problem.message for name in ("team-a", "team-b", "amr-07"))


def test_who_names_no_robot_is_not_told_those_that_do_not_admit_him() -> None:
    ghost = make_app(robots={"nodeSelector": {"matchLabels": {"robotics.io/robot": "amr-99"}}})
    theirs = [make_node("n1", robot="theirs", annotations=TEAMS), make_node("n2", robot="theirs")]
    (problem,) = problems_of(ghost, by_name([*theirs, make_node("n3", robot="ours")]))
    assert "ours" in problem.message
    assert "theirs" not in problem.message
    (problem,) = problems_of(ghost, by_name(theirs))
    assert "no robot admits namespace default" in problem.message
    assert "theirs" not in problem.message


def test_a_closed_robot_reads_like_none_whoever_asks_for_it() -> None:
    closed = by_name([make_node("n", robot="amr-07", annotations=TEAMS)])
    for selector in (
        {"matchLabels": {"robotics.io/robot": "amr-07"}},
        {"matchExpressions": [{"key": "robotics.io/robot", "operator": "Exists"}]},
    ):
        app = make_app(robots={"nodeSelector": selector})
        assert problems_of(app, closed) == problems_of(app, {}) != ()


def test_a_closed_node_reads_like_none_to_who_names_it_for_the_roscore() -> None:
    app = make_app(ros={"distro": "noetic"}, ros2=None, placement={"masterNode": "n"})
    for node in (make_node("n", robot="amr-07", annotations=TEAMS), make_node("n", annotations=TEAMS)):
        (problem,) = problems_of(app, by_name([node]))
        assert (problem,) == problems_of(app, {})
        assert 'there is no node "n" that admits namespace default' in problem.message
    assert problems_of(app, by_name([make_node("n", robot="amr-07")])) == ()


def reserving(*ids: int) -> Pool:
    return Pool(metadata=PoolMeta(name="default"), spec=PoolSpec(ids="1-9", reserved=ids))


def test_an_app_that_names_a_reserved_id_is_not_accepted() -> None:
    app = make_app(ros2={"domain": 7})
    (problem,) = domain_problems(app, reserving(0, 7), ())
    assert (problem.reason, problem.field) == (Reason.INVALID_SPEC, "spec.ros2.domain")
    assert "domain 7 is reserved in pool default" in problem.message
    assert domain_problems(app, reserving(0), ()) == ()
    assert domain_problems(app, None, ()) == ()
    assert domain_problems(make_app(), reserving(7), ()) == ()


def test_an_app_that_holds_an_id_which_is_reserved_later_goes_on() -> None:
    app = make_app(ros2={"domain": 7})
    assert domain_problems(app, reserving(7), [domain_claim(7)]) == ()
    assert domain_problems(app, reserving(7), [domain_claim(6), domain_claim(7, pool="other")])


def test_who_joins_the_domain_of_another_asks_for_no_id() -> None:
    app = make_app(ros2={"domain": 7, "shareWith": [{"name": "lead"}]})
    assert domain_problems(app, reserving(7), ()) == ()


def test_every_problem_is_reported_not_only_the_first() -> None:
    app = make_app(ros={"distro": "humbel"}, ros1={"master": "Managed"}, placement={"masterNode": "ghost"})
    assert [problem.field for problem in problems_of(app, {})] == [
        "spec.ros.distro",
        "spec.ros1",
        "spec.placement.masterNode",
    ]


def test_a_problem_prints_its_field_first() -> None:
    (problem,) = problems_of(make_app(placement={"masterNode": "ghost"}), {})
    assert str(problem).startswith("spec.placement.masterNode: ")


@pytest.mark.parametrize(
    ("fields", "field", "says"),
    [
        ({"env": [{"name": "ROBOTAPP_ROBOT", "value": "x"}]}, "env", "belongs to the operator"),
        ({"devices": [{"name": "g", "type": "gpu", "count": 2}]}, "devices[0].count", "nvidia.com/gpu: 2"),
        ({"ready": {"topic": {"name": "/odom", "minRate": 0}}}, "ready.topic.minRate", "0 is no rate"),
        (
            {"template": {"spec": {"volumes": [{"name": "robotapp-parameters", "emptyDir": {}}]}}},
            "template.spec.volumes[0].name",
            "write another name",
        ),
        ({"parameters": [{"inline": "a: [b"}]}, "parameters[0].inline", "is no YAML"),
        ({"parameters": [{"inline": "/**: {ros__parameters: {t: !!bool x}}"}]}, "parameters[0].inline", "is no YAML"),
        (
            {
                "command": ["/bin/sh", "-c"],
                "args": ["exec ros2 run a b"],
                "parameters": [{"inline": "/**: {ros__parameters: {}}"}],
            },
            "parameters",
            "passes them to nobody",
        ),
        (
            {
                "parameters": [{"inline": "/**: {ros__parameters: {}}"}],
                "volumeMounts": [{"name": "v", "mountPath": "/etc/robotapp/parameters/"}],
                "template": {"spec": {"volumes": [{"name": "v", "emptyDir": {}}]}},
            },
            "volumeMounts[0].mountPath",
            "write another path",
        ),
        (
            {
                "template": {
                    "spec": {"initContainers": [{"name": "x", "env": [{"name": "ROS_DOMAIN_ID", "value": "7"}]}]}
                }
            },
            "template.spec.initContainers[0].env",
            "use spec.ros2.domain",
        ),
        (
            {"template": {"spec": {"initContainers": [{"name": "a"}]}}},
            "template.spec.initContainers[0].name",
            "the component itself",
        ),
        ({"parameters": [{"inline": "- a"}]}, "parameters[0].inline", "must be a mapping"),
        ({"volumeMounts": [{"name": "maps", "mountPath": "/m"}]}, "volumeMounts[0].name", 'there is no volume "maps"'),
        (
            {"resources": {"requests": {"memory": "1Gi"}, "limits": {"memory": "512Mi"}}},
            'resources.requests["memory"]',
            "1Gi is more than the limit 512Mi",
        ),
        ({"parameters": [{"inline": "/**: {v: 1.0}"}]}, "parameters[0].inline", "/**/v must be a mapping"),
        ({"parameters": [{"inline": "/**: {}"}]}, "parameters[0].inline", "/** is empty"),
        (
            {"parameters": [{"configMapKeyRef": {"name": "c", "key": "$(ROBOTAPP_ROBOT).yaml"}}]},
            "parameters[0].configMapKeyRef.key",
            "the app has none",
        ),
    ],
)
def test_what_a_component_cannot_have_is_refused(fields: dict[str, object], field: str, says: str) -> None:
    _, at, message = only_problem(make_app(component("a", **{"args": ["run"], **fields})))
    assert at == f"spec.components[0].{field}"
    assert says in message


@pytest.mark.parametrize(
    "text",
    [
        "/**: {ros__parameters: {v: 1.0}}",
        "driver: {ros__parameters: {}}",
        "ns: {driver: {ros__parameters: {list: [1.0, 2.0], nested: {a: true}}}}",
    ],
)
def test_parameter_files_as_ros_reads_them_are_accepted(text: str) -> None:
    assert problems_of(make_app(component("a", args=["run"], parameters=[{"inline": text}])), {}) == ()


@pytest.mark.parametrize(
    "script", ['exec ros2 run a b "$0" "$@"', "for f in $ROBOTAPP_PARAMETER_FILES; do cat $f; done"]
)
def test_a_script_that_looks_at_its_files_is_accepted(script: str) -> None:
    files = [{"inline": "/**: {ros__parameters: {}}"}]
    app = make_app(component("a", command=["bash", "-c", script], parameters=files))
    assert problems_of(app, {}) == ()


def test_a_key_for_which_the_api_server_would_refuse_the_deployment_is_refused() -> None:
    template = {"metadata": {"labels": {"k" * 64: "x", "example.com/team": "x"}}}
    _, field, message = only_problem(make_app(component("a", template=template)))
    assert field == "spec.components[0].template.metadata.labels"
    assert message.endswith("has 64 characters; write at most 63")


@pytest.mark.parametrize(
    ("selector", "field"),
    [
        ({"matchLabels": {"robotics.io/robot": "amr-07,amr-08"}}, 'matchLabels["robotics.io/robot"]'),
        (
            {"matchExpressions": [{"key": "robotics.io/robot", "operator": "In", "values": ["amr-07", "amr 08"]}]},
            "matchExpressions[0].values",
        ),
    ],
)
def test_a_selector_of_robots_that_no_node_can_match_is_refused(selector: dict[str, object], field: str) -> None:
    app = make_app(component("a"), robots={"nodeSelector": selector})
    found = [problem for problem in problems_of(app, {}) if problem.field.endswith(field)]
    assert [problem.message for problem in found]
    assert all("matchExpressions with operator In" in problem.message for problem in found)


@pytest.mark.parametrize(
    ("value", "says"),
    [
        ("-amr", "begin and end with a letter or digit"),
        ("a b", '"a b" is no value'),
        ("v" * 64, "has 64 characters; write at most 63"),
    ],
)
def test_a_value_of_a_node_selector_that_no_label_can_have_is_refused(value: str, says: str) -> None:
    template = {
        "spec": {"nodeSelector": {"kubernetes.io/arch": "arm64", "example.com/empty": "", "example.com/kind": value}}
    }
    _, field, message = only_problem(make_app(component("a", template=template)))
    assert field == "spec.components[0].template.spec.nodeSelector"
    assert says in message


@pytest.mark.parametrize("value", ["abc", "", None, True, {"a": 1}])
def test_what_is_no_quantity_ends_no_check(value: object) -> None:
    for resources in (
        {"requests": {"cpu": value}, "limits": {"cpu": "1"}},
        {"requests": {"cpu": 1}, "limits": {"cpu": value}},
    ):
        assert problems_of(make_app(component("a", resources=resources)), {}) == ()


def test_annotations_of_the_template_take_room_from_inline_files() -> None:
    file = {"inline": f"/**: {{ros__parameters: {{v: {'x' * 60_000}}}}}"}
    template = {"metadata": {"annotations": {f"example.com/{number}": "x" * 4000 for number in range(8)}}}
    app = make_app(component("a", args=["run"], parameters=[file] * 3, template=template))
    assert "192 KiB together" in only_problem(app)[2]


def test_inline_files_of_one_app_are_bounded_because_reading_them_takes_time_from_others() -> None:
    file = {"inline": f"/**: {{ros__parameters: {{v: {'x' * 60_000}}}}}"}
    parts = [component(name, args=["run"], parameters=[file] * 3) for name in ("a", "b")]
    _, field, message = only_problem(make_app(*parts))
    assert (field, "256 KiB together" in message) == ("spec.components", True)


def test_inline_files_have_to_fit_into_the_annotations_of_a_pod() -> None:
    file = {"inline": f"/**: {{ros__parameters: {{v: {'x' * 60_000}}}}}"}
    assert problems_of(make_app(component("a", args=["run"], parameters=[file] * 3)), {}) == ()
    assert "192 KiB together" in only_problem(make_app(component("a", args=["run"], parameters=[file] * 4)))[2]


def edge(**fields: object) -> dict[str, object]:
    return {"topic": "/odom", "from": "driver", "to": "operator"} | fields


@pytest.mark.parametrize(
    ("one", "other", "field"),
    [
        ({"type": "nav_msgs/msg/Odometry"}, {"type": "std_msgs/msg/String"}, "type"),
        ({"rateHz": 20}, {"rateHz": 10}, "rateHz"),
        ({"qos": {"reliability": "reliable"}}, {"qos": {"reliability": "best_effort"}}, "qos.reliability"),
    ],
)
def test_edges_of_one_publisher_must_not_contradict_each_other(
    one: dict[str, object], other: dict[str, object], field: str
) -> None:
    parts = [component(name) for name in ("driver", "operator", "logger")]
    app = make_app(*parts, edges=[edge(**one), edge(to="logger", **other)])
    _, at, message = only_problem(app)
    assert at == f"spec.edges[1].{field}"
    assert "the first is spec.edges[0]" in message
    assert problems_of(make_app(*parts, edges=[edge(**one), edge(to="logger")]), {}) == ()
    assert problems_of(make_app(*parts, edges=[edge(**one), edge(kind="Service", to="logger", **other)]), {}) == ()


def test_equal_rates_in_other_words_are_no_contradiction() -> None:
    parts = [component(name) for name in ("driver", "operator", "logger")]
    assert problems_of(make_app(*parts, edges=[edge(rateHz="500m"), edge(to="logger", rateHz="0.5")]), {}) == ()
    one, other = {"deadline": "1s", "lease": "90s"}, {"deadline": "1000ms", "lease": "1m30s"}
    assert problems_of(make_app(*parts, edges=[edge(qos=one), edge(to="logger", qos=other)]), {}) == ()


def test_who_names_another_scheduler_is_told_what_it_does_not_do() -> None:
    device = {"name": "c", "type": "can", "onLoss": "Restart"}
    parts = [component("a", onDisconnect="Stop"), component("b", devices=[device])]
    moving = {"reschedule": {"when": "BudgetExceeded"}}
    assert notes_of(make_app(*parts, placement=moving)) == ()
    move, stop, loss = notes_of(make_app(*parts, placement=moving, schedulerName="default-scheduler"))
    assert move.startswith(
        "spec.placement.reschedule.when: BudgetExceeded has no effect with scheduler default-scheduler"
    )
    assert stop.startswith("spec.components[0].onDisconnect: Stop acts like Failover with scheduler default-scheduler")
    assert loss.startswith("spec.components[1].devices: onLoss has no effect with scheduler default-scheduler")


def test_fields_without_effect_are_told_and_do_not_refuse_the_app() -> None:
    app = make_app(
        component("a", devices=[{"name": "c", "type": "can", "sharing": "Namespace", "onLoss": "Restart"}]),
        component("b"),
        placement={"objective": "Balance", "fallback": {"steps": ["Wait"]}},
        ros2={"transport": "SHM"},
        edges=[{"topic": "/t", "from": "a", "to": "b", "bandwidth": "40M"}],
    )
    assert problems_of(app, {}) == ()
    assert [note.partition(": ")[0] for note in notes_of(app)] == [
        "spec.placement.fallback",
        "spec.ros2.transport",
        "spec.edges[0].bandwidth",
        "spec.components[0].devices[0].sharing",
        "spec.components[0].devices[0].onLoss",
    ]
    assert notes_of(make_app()) == ()


def test_an_interface_that_no_agent_publishes_is_noted_and_a_model_is_taken_as_its_maker_writes_it() -> None:
    # A label written by hand may give the interface _x.
    camera = {"type": "video", "model": "Intel(R) RealSense 435i", "interface": "_x"}
    (note,) = notes_of(
        make_app(component("a", devices=[camera | {"name": "cam"}], requires=[{"type": "can", "interface": "***"}]))
    )
    assert note.startswith("spec.components[0].requires[0].interface: ")
    assert note.endswith("leave it out")


def test_a_fallback_is_noted_where_no_budget_is_preferred_and_where_another_scheduler_places() -> None:
    edge = {"topic": "/t", "from": "operator", "to": "driver", "latency": {"budget": "30ms"}}
    preferred = edge | {"latency": {"budget": "30ms", "enforce": "Preferred"}}
    waits = {"fallback": {"steps": ["Wait"]}}
    assert notes_of(make_app(edges=[preferred], placement=waits)) == ()
    assert notes_of(make_app(edges=[edge], placement=waits)) == (
        "spec.placement.fallback: changes nothing: no edge has a budget with enforce: Preferred",
    )
    (note,) = notes_of(make_app(edges=[preferred], placement=waits, schedulerName="default-scheduler"))
    assert note.startswith("spec.placement.fallback: has no effect with scheduler default-scheduler")
    balanced = {"placement": {"objective": "Balance"}}
    assert notes_of(make_app(**balanced)) == ()
    (note,) = notes_of(make_app(**balanced, schedulerName="default-scheduler"))
    assert note.startswith("spec.placement.objective: Balance has no effect with scheduler default-scheduler")


@pytest.mark.parametrize(
    ("stated", "field"), [({"bandwidth": "40M"}, "bandwidth"), ({"rateHz": 30, "messageBytes": 900_000}, "rateHz")]
)
def test_a_bandwidth_is_noted_with_the_nodes_on_which_it_is_checked_and_where_nobody_checks_it(
    stated: dict[str, Any], field: str
) -> None:
    plain = {"topic": "/t", "from": "operator", "to": "driver"}
    edges = [plain, {"topic": "/image", "from": "driver", "to": "operator", **stated}]
    (note,) = notes_of(make_app(edges=edges))
    assert note.startswith(
        f"spec.edges[1].{field}: bandwidth is checked on nodes whose annotation robotics.io/link-bandwidth"
    )
    (note,) = notes_of(make_app(edges=edges, schedulerName="default-scheduler"))
    assert (
        note
        == f"spec.edges[1].{field}: has no effect with scheduler default-scheduler, which knows nothing of access links"
    )
    assert notes_of(make_app(edges=[plain])) == ()


def test_a_name_that_is_none_for_some_robot_is_refused_with_the_robot_and_the_field() -> None:
    part = component("a", envFrom=[{"configMapRef": {"name": "env-$(ROBOTAPP_ROBOT)"}}])
    app = make_app(part, robots=EACH)
    assert problems_of(app, robots("amr-07", "AMR_08")) == ()
    problems = name_problems(app, ["amr-07", "AMR_08"])
    assert list(problems) == ["AMR_08"], "the others run"
    assert problems["AMR_08"].startswith(
        'spec.components[0].envFrom[0].configMapRef.name: env-$(ROBOTAPP_ROBOT) is for robot AMR_08: "env-AMR_08" is no name of an object'
    )


def test_names_that_overrides_add_are_looked_at_too() -> None:
    file = {"configMapKeyRef": {"name": "p-$(ROBOTAPP_ROBOT)", "key": "a"}}
    override = {"name": "some", **EACH, "components": [{"name": "a", "parameters": [file]}]}
    app = make_app(component("a", args=["x"]), robots=EACH, overrides=[override])
    (problem,) = name_problems(app, ["AMR_08"]).values()
    assert problem.startswith("spec.overrides[0].components[0].parameters[0].configMapKeyRef.name: ")


def test_an_override_that_chooses_no_robot_is_told() -> None:
    override = {
        "name": "none",
        "nodeSelector": {"matchLabels": {"x": "y"}},
        "components": [{"name": "a", "image": "i"}],
    }
    app = make_app(component("a"), robots=EACH, overrides=[override])
    assert override_notes(app, robots("amr-07")) == (
        "spec.overrides[0].nodeSelector: override none chooses none of the app's robots",
    )
    chosen = make_app(component("a"), robots=EACH, overrides=[override | EACH])
    assert override_notes(chosen, robots("amr-07")) == ()


@pytest.mark.parametrize(
    ("part", "says"),
    [
        ({"name": "b", "image": "i"}, '"b" is no component of this app'),
        ({"name": "a", "env": [{"name": "ROS_DOMAIN_ID", "value": "1"}]}, "use spec.ros2.domain"),
        ({"name": "a", "parameters": [{"inline": "- a"}]}, "must be a mapping"),
    ],
)
def test_what_an_override_makes_of_a_component_is_looked_at(part: dict[str, object], says: str) -> None:
    override = {"name": "some", **EACH, "components": [part]}
    app = make_app(component("a", args=["x"]), robots=EACH, overrides=[override])
    _, field, message = only_problem(app)
    assert field.startswith("spec.overrides[0].components[0].")
    assert says in message


def test_secrets_whose_changes_restart_nothing_are_told_unless_they_are_followed_or_nobody_wants_restarts() -> None:
    part = component("a", envFrom=[{"secretRef": {"name": "vpn-$(ROBOTAPP_ROBOT)"}}])
    (note,) = secret_notes(make_app(part, robots=EACH), followed=False)
    assert note.startswith(
        "a change of Secret vpn-$(ROBOTAPP_ROBOT) restarts nothing, because the operator may not watch"
    )
    assert secret_notes(make_app(part, robots=EACH), followed=True) == ()
    assert secret_notes(make_app(part, robots=EACH, update={"onConfigChange": "None"}), followed=False) == ()
    assert secret_notes(make_app(component("a")), followed=False) == ()
