"""Settings of Rigel's orchestration plugin: what is checked, what is merged how, what is said about the rest."""

import pytest
from tests.support.rigel.jobfiles import with_block
from tests.support.rigel.rigelfiles import TWO, orchestration, refusal, rendered, spec


def block(settings: str) -> str:
    return with_block(f"{{application_image: 'a/b:1', {settings}}}")


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ("readiness: {}", "readiness: command is missing"),
        ("readiness: {command: 'a \"'}", "No closing quotation"),
        ("readiness: {command: a, period_seconds: 0}", "period_seconds: must be from 1 to 86400, found 0"),
        ("readiness: {command: a, periods: 1}", "(did you mean period_seconds?)"),
        ("rolling_update: {max_surge: -1}", "max_surge: must be from 0 to 86400, found -1"),
        ("rolling_update: {max_surge: 25%}", "expected a whole number, found text (25%)"),
        ("distributed: {enabled: 1}", "expected true or false, found a number (1)"),
        ("persistent_storage: {volumes: [{name: a}]}", "size is missing"),
        ("persistent_storage: {volume: []}", "(did you mean volumes?)"),
        ("results: {source_path: /a, contaner: b}", "(did you mean container?)"),
        ("additional_k8s_params: {aplication: {}}", "(did you mean application?)"),
        ("additional_k8s_params: {application: {spec: {template: {spec: {containers: [{name: helper}]}}}}}", "container 'helper' is a second one"),
        ("additional_k8s_params: {application: {spec: {template: {spec: {containers: [{imag: x}]}}}}}", "(did you mean image?)"),
        ("additional_k8s_params: {application: {spec: {template: {spec: {hostUsers: true}}}}}", "template.spec.hostUsers is not a field"),
    ],
)  # fmt: skip
def test_a_setting_that_cannot_be_meant_is_refused_with_its_line(settings: str, message: str) -> None:
    found = refusal(block(settings))
    assert message in found
    assert found.startswith("Rigelfile:1")


@pytest.mark.parametrize(
    "setting", ["readiness: {command: a}", "distributed: {enabled: true}", "persistent_storage: {volumes: []}"]
)
def test_one_setting_for_several_packages_is_refused_with_where_to_write_it(setting: str) -> None:
    assert "there are several components: write it under components.<name>" in refusal(orchestration(setting, TWO))


def test_lists_of_named_entries_are_merged_by_name() -> None:
    container = "{name: ros-app, volumeMounts: [{name: logs, mountPath: /other}, {name: tmp, mountPath: /t}]}"
    pod = f"{{containers: [{container}], volumes: [{{name: tmp, emptyDir: {{}}}}], schedulerName: lab}}"
    found = spec(
        block(
            "persistent_storage: {volumes: [{name: logs, size: 1Gi}]}, "
            f"additional_k8s_params: {{application: {{spec: {{replicas: 2, template: {{metadata: {{labels: {{team: a}}}}, spec: {pod}}}}}}}}}"
        )
    )
    (component,) = found["components"]
    assert component["volumeMounts"] == [{"name": "logs", "mountPath": "/other"}, {"name": "tmp", "mountPath": "/t"}]
    assert [volume["name"] for volume in component["template"]["spec"]["volumes"]] == ["logs", "tmp"]
    assert component["template"]["metadata"] == {"labels": {"team": "a"}}
    assert (component["replicas"], found["schedulerName"]) == (2, "lab")


def test_what_the_operator_decides_is_noted() -> None:
    text = block(
        "additional_k8s_params: {ros_master: {spec: {replicas: 1}}, application: {metadata: {name: x}, spec: {strategy: {}}}}"
    )
    notes = " ".join(rendered(text).notes)
    assert "application.metadata is not carried over: the operator names and labels what it makes" in notes
    assert "spec.strategy is not carried over: the operator decides it" in notes
    assert "ros_master is not carried over, but for its image" in notes
