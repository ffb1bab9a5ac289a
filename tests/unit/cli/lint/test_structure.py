"""The schema, offline: every wrong value is refused by its path, with what to write instead."""

import json
from collections.abc import Iterator
from typing import Any

import pytest
import yaml
from tests.support.apiobjects import app, component, edge, pool
from tests.support.seeds import choose_for_today
from tests.support.wrong_input.gone_fields import GONE_FIELDS, GONE_VALUES, with_field
from tests.support.wrong_input.malformed import full_app, malformed_apps

from robotapp_api.model.app.robotapp import RobotApp
from robotapp_api.schema.crd import schema_of
from robotapp_cli.lint import wording
from robotapp_cli.lint.definitions import KINDS, definition
from robotapp_cli.lint.findings import Located, Path, Severity
from robotapp_cli.lint.linter import MOST_FINDINGS, lint

DURATIONS = (
    "spec.components[].policies.latencyBudget",
    "spec.components[].policies.deadline",
    "spec.edges[].qos.deadline",
    "spec.edges[].qos.lease",
    "spec.edges[].requestedQos.deadline",
    "spec.edges[].requestedQos.lease",
    "spec.edges[].latency.budget",
    "spec.placement.fallback.after",
    "spec.placement.reschedule.for",
    "spec.placement.reschedule.cooldown",
    "spec.connectivity.grace",
    "spec.recordings[].split.duration",
    "spec.completion.deadline",
    "spec.completion.ttl",
)
GONE = {path: value for path, value in GONE_FIELDS["RobotApp"].items() if not path.startswith("status.")}


def found(obj: dict[str, Any]) -> list[Located]:
    return lint(json.dumps(obj, ensure_ascii=False).encode()).findings


def duration_cure(field: str, value: Any) -> str:
    """Returns the example in the cure of a duration that is not text."""
    parent, _, name = field.rpartition(".")
    (finding,) = [
        finding
        for finding in found(with_field("RobotApp", parent, {name: value}))
        if finding.severity is Severity.ERROR
    ]
    assert finding.path == field.replace("[]", "[0]")
    begin, cure = finding.message.split("; write a number and its unit (us, ms, s, m or h), such as ")
    assert begin
    return cure


def only(obj: dict[str, Any]) -> tuple[str, str]:
    (finding,) = found(obj)
    return finding.path, finding.message


def of_component(**fields: Any) -> tuple[str, str]:
    path, message = only(app(components=[component(**fields)]))
    return path.removeprefix("spec.components[0]"), message


@pytest.mark.parametrize(
    ("fields", "cure"),
    [
        ({"hostNetwork": True}, "write template: {spec: {hostNetwork: true}}"),
        ({"network_mode": "host"}, "write template: {spec: {hostNetwork: true}} for host"),
        ({"privileged": True}, "write securityContext: {privileged: true}"),
        ({"shm_size": "1g"}, "write sharedMemory: {size: 1Gi}"),
        ({"template": {"spec": {"affinity": {}}}}, "write nodeSelector, runsOn, requires, colocateWith"),
        ({"completions": 1}, "write job: {} for a program that ends"),
        ({"backoffLimit": 1}, "write job: {backoffLimit: …}"),
        ({"job": {"restartPolicy": "Never"}}, "as often as job.backoffLimit"),
        ({"restartPolicy": "Never"}, "as often as job.backoffLimit"),
        ({"job": {"parallelism": 2}}, "spec.matrix"),
        ({"job": {"schedule": "0 3 * * *"}}, 'write schedule: {cron: "0 2 * * *"} beside job'),
        ({"job": {"timeZone": "Europe/Athens"}}, "write schedule: {cron: …, timeZone: …} beside job"),
        (
            {"job": {}, "schedule": {"cron": "0 3 * * *", "concurrencyPolicy": "Forbid"}},
            "due times while a run goes on are skipped",
        ),
        ({"job": {}, "schedule": {"cron": "0 3 * * *", "suspend": True}}, "write replicas: 0"),
        ({"job": {"ttlSecondsAfterFinished": 60}}, "write completion: {ttl: 1h} in spec"),
        ({"job": {"maxRestarts": 3}}, "write completion: {maxRestarts: 3} in spec"),
        (
            {"template": {"spec": {"activeDeadlineSeconds": 9}}},
            "write job: {activeDeadlineSeconds: …} in the component",
        ),
        ({"expose": 80}, "write service: {spec: {ports: [{name: http, port: 80}]}}"),
        (
            {"service": {"port": 1, "spec": {"ports": [{"name": "a", "port": 1}]}}},
            "write spec: {ports: [{name: http, port: 80}]}",
        ),
    ],
)
def test_what_other_kinds_have_is_answered_with_what_to_write(fields: dict[str, Any], cure: str) -> None:
    _, message = of_component(**fields)
    assert cure in message


@pytest.mark.parametrize(
    ("fields", "path", "cure"),
    [
        ({"schedule": "0 3 * * *"}, "spec.schedule", "beside job in the component"),
        ({"ttl": "1h"}, "spec.ttl", "write completion: {ttl: 1h}"),
        ({"completion": {"ttlSecondsAfterFinished": 9}}, "spec.completion.ttlSecondsAfterFinished", "{ttl: 1h}"),
    ],
)
def test_a_clock_and_an_end_of_jobs_are_answered_with_what_there_is(
    fields: dict[str, Any], path: str, cure: str
) -> None:
    assert cure in {one.path: one.message for one in found(app(**fields))}[path]


def test_short_forms_that_people_write_are_answered_with_the_long_one() -> None:
    assert "write latency: {budget: 30ms}" in only(app(edges=[edge(latency="30ms")]))[1]
    (text,) = [one.message for one in found(app(robots=["amr-07", "amr-08"])) if one.path == "spec.robots"]
    assert "{key: robotics.io/robot, operator: In, values: [amr-07, amr-08]}" in text


def test_the_full_app_has_nothing_wrong_in_its_schema() -> None:
    # ROS 1 and 2 together are the operator's matter, and so are notes.
    assert {each.reason for each in found(full_app())} <= {"InvalidSpec", "Note"}


def test_every_wrong_value_is_refused_by_its_path() -> None:
    """A third of them a day; `integration/crds/test_malformed_live.py` shows all of them to the API server."""
    for case in choose_for_today(malformed_apps(schema_of(RobotApp))):
        paths = [each.path for each in found(case.obj) if each.severity is Severity.ERROR]
        assert any(path == case.field or path.startswith((f"{case.field}[", f"{case.field}.")) for path in paths), (
            case.field,
            paths,
        )


@pytest.mark.parametrize("kind", KINDS)
def test_every_pattern_has_words_with_an_example(kind: str) -> None:
    for path, pattern in patterns(definition(kind).schema, ()):
        text = wording.message(wording.Misfit(path, "pattern", pattern, "?", {}), {})
        assert pattern not in text
        assert "such as" in text or "@robot" in text, text


def patterns(schema: dict[str, Any], path: Path) -> Iterator[tuple[Path, str]]:
    if "pattern" in schema:
        yield path, schema["pattern"]
    for key, member in schema.get("properties", {}).items():
        yield from patterns(member, (*path, key))
    for key, step in (("items", 0), ("additionalProperties", "any")):
        if key in schema:
            yield from patterns(schema[key], (*path, step))


def durations(schema: dict[str, Any], path: str) -> Iterator[str]:
    """Paths of fields whose rule names units of time."""
    if any("(us, ms, s, m or h)" in rule["message"] for rule in schema.get("x-kubernetes-validations", ())):
        yield path
    for key, member in schema.get("properties", {}).items():
        yield from durations(member, f"{path}.{key}")
    if "items" in schema:
        yield from durations(schema["items"], f"{path}[]")


class TestOldNames:
    @pytest.mark.parametrize("path", GONE)
    def test_a_name_that_is_gone_is_refused_with_what_to_write_now(self, path: str) -> None:
        field = path.replace("[]", "[0]")
        messages = [each.message for each in found(with_field("RobotApp", path, GONE[path])) if each.path == field]
        (message,) = messages
        assert message.startswith("unknown field; ")
        assert "write" in message or "remove" in message, message

    @pytest.mark.parametrize("path", GONE_VALUES["RobotApp"])
    def test_a_value_that_is_gone_is_refused_with_what_to_write_now(self, path: str) -> None:
        field = path.replace("[]", "[0]")
        wrong = with_field("RobotApp", path, GONE_VALUES["RobotApp"][path])
        (message,) = [each.message for each in found(wrong) if each.path.startswith(field)]
        assert "write" in message or "quotes" in message, message

    def test_a_renamed_field_that_is_required_is_not_called_missing_as_well(self) -> None:
        wrong = app(robots={"selector": {"matchLabels": {"robotics.io/robot": "amr-07"}}})
        assert only(wrong) == ("spec.robots.selector", "unknown field; write nodeSelector")


class TestFields:
    def test_a_misspelled_field_is_recognised_and_its_right_name_not_called_missing(self) -> None:
        wrong = app(components=[{"name": "a", "imgae": "i"}])
        assert only(wrong) == ("spec.components[0].imgae", "unknown field; did you mean image?")

    def test_a_field_at_the_wrong_place_is_sent_to_its_place(self) -> None:
        assert only(app(isolation="Domain")) == (
            "spec.isolation",
            "unknown field; a field of this name is spec.ros2.isolation",
        )

    def test_a_place_that_nobody_means_is_not_named(self) -> None:
        assert "initContainers" not in of_component(restartPolicyRules=[])[1]

    @pytest.mark.parametrize(
        ("fields", "cure"),
        [
            ({"action": "/execute_trajectory"}, "write topic: /execute_trajectory, kind: Action"),
            ({"service": "/plan"}, "write topic: /plan, kind: Service"),
            ({"service": ["/plan"]}, "write topic: …, kind: Service"),
            ({"name": "/cmd_vel"}, "write topic"),
        ],
    )
    def test_an_edge_named_by_its_kind_is_told_topic_and_kind(self, fields: dict[str, Any], cure: str) -> None:
        ends = {"from": "operator", "to": "driver"}
        (name,) = fields
        assert only(app(edges=[{**ends, **fields}])) == (f"spec.edges[0].{name}", f"unknown field; {cure}")

    def test_ends_of_an_edge_that_are_named_as_in_ros_are_from_and_to(self) -> None:
        for publisher, subscriber in (("publisher", "subscriber"), ("server", "client")):
            wrong = app(edges=[{"topic": "/x", publisher: "operator", subscriber: "driver"}])
            assert [(each.path, each.message) for each in found(wrong)] == [
                (f"spec.edges[0].{publisher}", "unknown field; write from"),
                (f"spec.edges[0].{subscriber}", "unknown field; write to"),
            ]

    def test_for_any_other_field_the_possible_ones_are_listed(self) -> None:
        assert only(app(ros={"distro": "jazzy", "zzz": 1})) == (
            "spec.ros.zzz",
            "unknown field; fields here are distro, version",
        )

    def test_a_missing_field_is_shown_as_it_is_written(self) -> None:
        wrong = app()
        del wrong["spec"]["ros"]
        path, message = only(wrong)
        assert path == "spec.ros"
        assert message.startswith("this field is missing; write ros: {distro: …} (ROS version")

    def test_a_field_without_a_value_is_a_warning_because_the_api_server_drops_it(self) -> None:
        wrong = app(edges=None)
        (finding,) = found(wrong)
        assert (finding.severity, finding.path) == (Severity.WARNING, "spec.edges")

    def test_a_required_field_without_a_value_is_missing(self) -> None:
        assert of_component(image=None)[1].startswith("this field is missing; write image")

    def test_a_status_in_a_file_is_a_warning(self) -> None:
        (finding,) = found({**app(), "status": {"phase": "Running"}})
        assert (finding.severity, finding.path) == (Severity.WARNING, "status")


class TestValues:
    @pytest.mark.parametrize(
        ("fields", "path", "message"),
        [
            ({"env": [{"name": "A", "value": 7}]}, ".env[0].value", "must be text, but is the number 7; put it in quotes, as it is written"),
            (
                {"env": [{"name": "A", "value": True}]},
                ".env[0].value",
                "must be text, but is true; put it in quotes (YAML reads yes, no, on and off as true and false)",
            ),
            ({"replicas": "2"}, ".replicas", 'must be a whole number, but is the text "2"; remove the quotes'),
            ({"args": "ros2"}, ".args", 'must be a list, but is the text "ros2"; write [ros2]'),
            ({"devices": {"name": "a"}}, ".devices", "must be a list, but is a mapping; begin each entry with -"),
            ({"env": {"ROS_X": 30}}, ".env", 'each entry has a name and a value: - {name: ROS_X, value: "30"}'),
            ({"env": {"A": {}}}, ".env", "begin each entry with -"),
            ({"image": ["acme/driver:1"]}, ".image", 'must be text, but is a list; write "acme/driver:1" without brackets'),
            ({"policies": "fast"}, ".policies", "must be a mapping of fields, but is the text"),
            ({"args": [None]}, ".args[0]", "must be text, but is empty"),
            ({"replicas": -1}, ".replicas", "is -1; write at least 0"),
            ({"replicas": 33}, ".replicas", "is 33; write at most 32"),
            ({"image": ""}, ".image", "must not be empty"),
            ({"colocateWith": [f"c{at}" for at in range(9)]}, ".colocateWith", "has 9 entries; write at most 8"),
            ({"qosClass": "real_time"}, ".qosClass", '"real_time" is not possible; write realtime or sensor_data'),
            ({"resources": {"limits": {"cpu": 0.5}}}, ".resources.limits.cpu", "put it in quotes, as it is written"),
            ({"resources": {"limits": {"cpu": "2 cores"}}}, ".resources.limits.cpu", "write a quantity, such as 20, 500m"),
            ({"ports": [{"containerPort": 70_000}]}, ".ports[0].containerPort", "is 70000; write at most 65535"),
            ({"requires": [{"type": "GPU"}]}, ".requires[0].type", "write lower-case letters, digits and -"),
        ],
    )  # fmt: skip
    def test_a_wrong_value_is_named_with_what_to_write(self, fields: dict[str, Any], path: str, message: str) -> None:
        where, said = of_component(**fields)
        assert where == path
        assert message in said

    def test_several_values_of_a_label_are_an_expression(self) -> None:
        (finding,) = found(app(robots={"nodeSelector": {"matchLabels": {"robotics.io/robot": ["amr-01", "7"]}}}))
        assert finding.message.endswith(
            'matchExpressions: [{key: robotics.io/robot, operator: In, values: [amr-01, "7"]}]'
        )

    @pytest.mark.parametrize("field", DURATIONS)
    def test_a_duration_without_unit_is_told_to_have_one(self, field: str) -> None:
        examples = (
            {30: "30ms", 1.5: "1.5ms", 0: "30ms", -1: "30ms", 0.05: "50ms for 0.05 seconds", "yes": "30ms"}
            if field.startswith(("spec.components", "spec.edges"))
            else {30: "30s", 1.5: "1.5s", 0: "5m", -1: "5m", 0.05: "0.05s", "yes": "5m"}
        )
        for value, example in examples.items():
            assert duration_cure(field, True if value == "yes" else value) == example

    @pytest.mark.parametrize("field", ["spec.completion.ttl", "spec.completion.deadline"])
    def test_whole_seconds_of_another_api_stay_seconds(self, field: str) -> None:
        assert duration_cure(field, 3600) == "3600s"
        assert duration_cure(field, 31_536_000) == "8760h"

    def test_every_duration_of_an_app_is_in_the_list_above(self) -> None:
        named = {field.replace("requestedQos", "qos") for field in DURATIONS}
        spec = definition("RobotApp").schema["properties"]["spec"]
        assert {field.replace("requestedQos", "qos") for field in durations(spec, "spec")} == named

    @pytest.mark.parametrize(
        ("spec", "cure"),
        [
            ({"ros": {"distro": 7}}, "write a ROS distribution in lower case, such as jazzy, or none"),
            ({"edges": [edge(topic=7)]}, "write letters, digits, _ and /, such as /cmd_vel"),
            ({"edges": [edge(type=True)]}, "write a ROS interface, such as geometry_msgs/msg/Twist"),
            ({"edges": [edge(bandwidth=True)]}, "write bits per second, such as 40M"),
        ],
    )
    def test_quotes_are_no_cure_where_the_same_as_text_is_refused_too(self, spec: dict[str, Any], cure: str) -> None:
        assert only(app(**spec))[1].endswith(f"; {cure}")

    @pytest.mark.parametrize(
        ("spec", "cure"),
        [
            ({"components": [component(ready={"lifecycle": True})]}, "write Active"),
            ({"components": [component(imagePullPolicy=False)]}, "write Always or IfNotPresent or Never"),
            ({"placement": {"gang": True}}, "write All or None"),
            ({"edges": [edge(latency={"budget": "30ms", "percentile": "p95"})]}, "write 50 or 95"),
            ({"edges": [edge(latency={"budget": "30ms", "percentile": 99.9})]}, "write 50 or 95"),
            ({"edges": [edge(latency={"budget": "30ms", "percentile": "95"})]}, "remove the quotes"),
        ],
    )
    def test_values_that_are_listed_are_named_at_once(self, spec: dict[str, Any], cure: str) -> None:
        assert only(app(**spec))[1].rpartition("; ")[2] == cure

    @pytest.mark.parametrize(
        ("text", "cure"),
        [
            ("20Hz", "write 20 (per second)"),
            ("20 hz", "write 20 (per second)"),
            ("20/s", "write 20 (per second)"),
            ("12.5Hz", 'write "12.5" (per second)'),
            ("fast", 'write messages per second, such as 20 or "0.5"'),
        ],
    )
    def test_a_rate_with_its_unit_is_told_to_go_without(self, text: str, cure: str) -> None:
        rate = {"topic": {"name": "/x", "minRate": text}}
        assert of_component(ready=rate) == (".ready.topic.minRate", f'"{text}" is not possible; {cure}')
        assert only(app(edges=[edge(rateHz=text)]))[1] == f'"{text}" is not possible; {cure}'

    def test_a_bandwidth_is_in_bits_per_second(self) -> None:
        assert only(app(edges=[edge(bandwidth="5MB/s")]))[1].endswith("write bits per second, such as 40M")

    def test_what_helm_has_not_rendered_is_told_to_be_rendered(self) -> None:
        helm = "a Helm template is checked as it is rendered: helm template … | kubectl robotapp lint -"
        template = "{{ .Values.x }}"
        for fields in ({"image": template}, {"replicas": template}, {"onDisconnect": template}):
            assert of_component(**fields)[1] == f'"{template}" is not possible; {helm}'

    def test_quantities_are_numbers_or_text_as_the_api_server_takes_them(self) -> None:
        resources = {"limits": {"cpu": 2, "memory": "1Gi", "nvidia.com/gpu": 1}}
        assert found(app(components=[component(resources=resources)])) == []

    def test_numbers_that_do_not_fit_their_format_are_refused(self) -> None:
        ports = [{"containerPort": 80, "name": "a" * 16}]
        security = {"runAsUser": 2**63}
        findings = found(app(components=[component(ports=ports, securityContext=security)]))
        assert [each.path for each in findings] == ["spec.components[0].securityContext.runAsUser"]

    def test_a_line_end_is_not_overlooked_at_the_end_of_a_name(self) -> None:
        assert of_component(name="driver\n")[0] == ".name"


class TestListsThatAreNone:
    """The cure for a scalar where a list is wanted is not refused in turn."""

    @pytest.mark.parametrize("field", ["command", "args"])
    @pytest.mark.parametrize(
        ("text", "cure"),
        [
            ("ros2 run nav2_amcl amcl", "[ros2, run, nav2_amcl, amcl]"),
            ("  sleep 5 ", '[sleep, "5"]'),
            ('bash -c "ros2 launch a b"', '[bash, -c, "ros2 launch a b"]'),
            ("ros2 run a b --ros-args -r __ns:=/$(ROBOTAPP_ROBOT)", '[ros2, run, a, b, --ros-args, -r, "__ns:=/$(ROBOTAPP_ROBOT)"]'),
            ("don't", '["don\'t"]'),
            ("source /opt/x.sh && ros2 run a b", '[bash, -c, "source /opt/x.sh && ros2 run a b"]'),
            ("source x\nros2 run a b\n", '[bash, -c, "source x\\nros2 run a b"]'),
            ("a # b", '[a, "#", b]'),
            ("a " * 1000, "every word as an entry of its own, as in [ros2, run, nav2_amcl, amcl]"),
        ],
    )  # fmt: skip
    def test_a_command_becomes_the_list_of_its_words(self, field: str, text: str, cure: str) -> None:
        assert of_component(**{field: text})[1].endswith(f"; write {cure}")

    def test_commands_of_probes_and_of_other_containers_are_commands_too(self) -> None:
        for fields in (
            {"livenessProbe": {"exec": {"command": "ros2 node list"}}},
            {"template": {"spec": {"initContainers": [{"name": "x", "image": "i", "command": "ros2 node list"}]}}},
        ):
            assert of_component(**fields)[1].endswith("write [ros2, node, list]")

    @pytest.mark.parametrize(
        ("value", "cure"),
        [
            ("17,18", "write [17, 18]"),
            (" [17, 018] ", "write [17, 18]"),
            ("17 18", "write [17, 18]"),
            ("17", "write [17]"),
            (17, "write [17]"),
            (0, "write [0]"),
            ("17-19", "write whole numbers, such as [1, 2]"),
            (1.5, "write whole numbers, such as [1, 2]"),
            ("9" * 5000, "write whole numbers, such as [1, 2]"),
        ],
    )
    def test_numbers_in_a_text_become_a_list_of_numbers(self, value: object, cure: str) -> None:
        path, message = only(pool(reserved=value))
        assert (path, message.rpartition("; ")[2]) == ("spec.reserved", cure)

    @pytest.mark.parametrize(
        ("fields", "cure"),
        [
            ({"runsOn": "Robot, Edge"}, "write [Robot, Edge]"),
            ({"runsOn": "robot"}, "write a list of Robot or Edge or Cloud"),
            ({"runsOn": True}, "write a list of Robot or Edge or Cloud"),
            ({"colocateWith": "b"}, "write [b]"),
            ({"colocateWith": "b,c"}, "write [b, c]"),
            ({"colocateWith": 7}, 'write ["7"]'),
            ({"colocateWith": "B"}, "write a list of lower-case letters, digits and -, such as camera-driver"),
            ({"args": 7}, 'write ["7"]'),
            ({"args": True}, 'write ["true"]'),
            ({"devices": "cam"}, "write [{name: …, type: …}]"),
        ],
    )
    def test_names_in_a_text_become_a_list_of_names(self, fields: dict[str, Any], cure: str) -> None:
        assert of_component(**fields)[1].rpartition("; ")[2] == cure


class TestLists:
    def test_entries_with_the_same_key_are_refused_with_both_lines(self) -> None:
        text = yaml.safe_dump(app(components=[component("a"), component("b"), component("a")]), sort_keys=False)
        (finding,) = lint(text.encode()).findings
        assert finding.path == "spec.components[2]"
        first = text.splitlines().index("  - name: a") + 1
        assert finding.message.startswith(f'name "a" stands already at spec.components[0] (line {first}); remove one')

    def test_keys_count_with_their_defaults(self) -> None:
        path, message = only(app(edges=[edge(), edge(kind="Topic")]))
        assert path == "spec.edges[1]"
        assert 'kind "Topic", topic "/cmd_vel"' in message
        assert found(app(edges=[edge(), edge(kind="Service")])) == []

    def test_a_set_holds_a_value_once(self) -> None:
        wrong = app(components=[component("a", colocateWith=["b", "b"]), component("b")])
        assert only(wrong)[0] == "spec.components[0].colocateWith[1]"


class TestObjects:
    @pytest.mark.parametrize(
        ("head", "path", "message"),
        [
            ({"apiVersion": "robotics.io/v1"}, "apiVersion", "write robotics.io/v1alpha1"),
            ({"apiVersion": "robotic.io/v1alpha1"}, "apiVersion", "write robotics.io/v1alpha1"),
            ({"apiVersion": None}, "apiVersion", "write apiVersion: robotics.io/v1alpha1"),
            ({"kind": "Robotapp"}, "kind", "did you mean RobotApp?"),
            ({"kind": None}, "kind", "write kind: RobotApp"),
            ({"metadata": {}}, "metadata.name", "this field is missing"),
            ({"metadata": {"name": "Tele_op"}}, "metadata.name", "write lower-case letters, digits, - and ."),
            ({"metadata": {"name": "a", "lables": {}}}, "metadata.lables", "did you mean labels?"),
            (
                {"metadata": {"name": "a", "labels": {"b": 1}}},
                "metadata.labels.b",
                "put it in quotes, as it is written",
            ),
            ({"spce": {}}, "spce", "did you mean spec?"),
        ],
    )
    def test_the_frame_of_an_object_is_checked_too(self, head: dict[str, Any], path: str, message: str) -> None:
        where, said = only({**app(), **head})
        assert where == path
        assert message in said

    @pytest.mark.parametrize("field", ["labels", "annotations"])
    @pytest.mark.parametrize(
        "key", ["my team", "x/y/z", "b c", "/x", "x/", "-a", "a..b/c", "", "k" * 64, "p" * 254 + "/k"]
    )
    def test_keys_that_kubernetes_refuses_are_found_where_they_stand(self, field: str, key: str) -> None:
        data = json.dumps({**app(), "metadata": {"name": "a", field: {"ok.io/team": "x", key: "x"}}}, indent=1)
        (finding,) = lint(data.encode()).findings
        assert finding.path.startswith(f"metadata.{field}")
        assert finding.place.line == data[: data.index(f'"{key}": "x"')].count("\n") + 1
        assert "; write " in finding.message

    def test_the_case_of_the_key_of_an_annotation_does_not_count_but_that_of_a_label(self) -> None:
        key = {"Example.com/team": "x"}
        assert found({**app(), "metadata": {"name": "a", "annotations": key}}) == []
        assert only({**app(), "metadata": {"name": "a", "labels": key}})[0] == 'metadata.labels["Example.com/team"]'

    @pytest.mark.parametrize(
        "template",
        [
            {"metadata": {"labels": {"my team": "x"}}},
            {"metadata": {"labels": {"k" * 64: "x"}}},
            {"metadata": {"annotations": {"a..b/c": "x"}}},
            {"spec": {"nodeSelector": {"my node": "x"}}},
        ],
    )
    def test_keys_of_the_pods_are_checked_once_as_well(self, template: dict[str, Any]) -> None:
        (part,) = template
        (field,) = template[part]
        assert of_component(template=template)[0] == f".template.{part}.{field}"

    def test_a_generated_name_is_a_name(self) -> None:
        assert found({**app(), "metadata": {"generateName": "teleop-"}}) == []

    def test_other_kinds_are_counted_and_left_alone(self) -> None:
        texts = [
            yaml.safe_dump(each)
            for each in (
                {"apiVersion": "v1", "kind": "ConfigMap", "data": {"a": 1}},
                {"apiVersion": "example.com/v1", "kind": "RobotApp"},
                {"apiVersion": "robotics.io/v1alpha1", "kind": "RobotClaim"},
                app(),
            )
        ]
        report = lint("---\n".join(texts).encode())
        assert (report.findings, dict(report.checked), report.skipped) == ([], {"RobotApp": 1}, 3)

    def test_lists_are_taken_apart_and_paths_begin_at_the_list(self) -> None:
        wrong = {"apiVersion": "v1", "kind": "List", "items": [pool(), app(suspend="no")]}
        assert only(wrong)[0] == "items[1].spec.suspend"

    @pytest.mark.parametrize("text", ["just text", "[1, 2]", "7", "{apiVersion: v1, kind: List, items: [7]}"])
    def test_what_is_no_object_is_said(self, text: str) -> None:
        (finding,) = lint(text.encode()).findings
        assert finding.message.startswith("an object is a mapping of fields")

    def test_findings_name_their_object_and_come_in_the_order_of_their_lines(self) -> None:
        texts = [yaml.safe_dump(each) for each in (pool(ids="x"), app(zzz=1), app("second", suspend=7))]
        findings = lint("---\n".join(texts).encode()).findings
        assert [each.object for each in findings] == ["DomainPool/default", "RobotApp/teleop", "RobotApp/second"]
        assert [each.place.line for each in findings] == sorted(each.place.line for each in findings)

    def test_thousands_of_mistakes_are_cut_off(self) -> None:
        wrong = app(components=[component(env=[{"name": 7, "value": 7} for _ in range(1000)])])
        findings = found(wrong)
        assert len(findings) == MOST_FINDINGS + 1
        assert sum(each.reason == "TooMany" for each in findings) == 1


def list_patterns(schema: dict[str, Any], path: Path = ()) -> Iterator[tuple[Path, str]]:
    """Yields the pattern of each field of a schema."""
    if "pattern" in schema:
        yield path, schema["pattern"]
    for name, member in schema.get("properties", {}).items():
        yield from list_patterns(member, (*path, name))
    for inner, step in ((schema.get("items"), 0), (schema.get("additionalProperties"), "key")):
        if isinstance(inner, dict):
            yield from list_patterns(inner, (*path, step))


@pytest.mark.parametrize("kind", KINDS)
def test_every_pattern_of_a_field_has_words(kind: str) -> None:
    found = list(list_patterns(definition(kind).schema))
    assert found
    assert [path for path, pattern in found if wording._words(path, pattern).startswith("what matches")] == []
