"""simulate: the cluster as the user may see it, thinned out, and the answer as a table."""

import copy
import json
from pathlib import Path

import msgspec
import pytest
import yaml
from tests.unit.cli.running import Json, Stage

from robotapp_cli.commands.simulate import thinned
from robotapp_scheduler.core.api.robotics_v1alpha1 import Component

WANTED = {
    "resources": [
        {"group": "", "version": "v1", "plural": "nodes", "kind": "Node", "namespaced": False},
        {"group": "", "version": "v1", "plural": "pods", "kind": "Pod", "namespaced": True},
    ]
}
PLACED = {
    "namespace": "fleet",
    "name": "p",
    "profile": "x",
    "node": "n1",
    "message": "",
    "feasible": 2,
    "score": 454,
    "was": "",
}
REFUSED = {
    **PLACED,
    "name": "q",
    "node": None,
    "message": "0/2 nodes are available: 2 Insufficient cpu.",
    "feasible": 0,
}
ANSWER = {
    "config": "abc",
    "nodes": 2,
    "placed": 1,
    "refused": 1,
    "moved": 0,
    "placements": [PLACED, REFUSED],
    "otherSchedulers": {"default-scheduler": 3},
    "ignored": {},
    "problems": [],
    "note": "not simulated: time",
}


@pytest.fixture
def cluster(stage: Stage) -> Stage:
    stage.add("/nodes", {"metadata": {"name": "n1", "managedFields": [{"manager": "kubelet"}]}})
    container = {"name": "c", "image": "i", "env": [{"name": "PASSWORD", "value": "secret"}]}
    stage.add("/pods", {"metadata": {"name": "p", "namespace": "fleet"}, "spec": {"containers": [container]}})
    stage.scheduler.wanted, stage.scheduler.outcome = WANTED, ANSWER
    return stage


def sent(stage: Stage) -> Json:
    (found,) = stage.scheduler.posted
    body: Json = json.loads(found)
    return body


def url(stage: Stage) -> tuple[str, str]:
    return "--scheduler-url", stage.scheduler.tls_url


def test_pods_are_shown_with_their_node_or_why_they_have_none(cluster: Stage) -> None:
    lines = cluster.text("simulate", *url(cluster)).splitlines()
    assert lines[0].split() == ["NAMESPACE", "POD", "NODE", "WHY"]
    assert lines[1].split()[:3] == ["fleet", "p", "n1"]
    assert lines[1].endswith("best of 2 feasible nodes, score 454")
    assert "Insufficient cpu" in lines[2]
    assert "1 of 2 pods placed on 2 nodes, configuration abc" in lines
    assert "3 pods wait for scheduler default-scheduler" in lines


NONE = {**ANSWER, "placed": 0, "refused": 0, "placements": [], "otherSchedulers": {}}


def test_where_no_pod_waits_that_is_said(cluster: Stage) -> None:
    cluster.scheduler.outcome = NONE
    assert cluster.text("simulate", *url(cluster)).startswith("No pod waits for this scheduler.\n")


@pytest.mark.parametrize("outcome", [NONE, ANSWER], ids=["nothing placed", "other pods placed"])
def test_what_is_no_pod_yet_is_named_as_left_out(cluster: Stage, tmp_path: Path, outcome: Json) -> None:
    cluster.scheduler.outcome = outcome
    app = tmp_path / "app.yaml"
    app.write_text("{kind: RobotApp, metadata: {name: teleop}}")
    text = cluster.text("simulate", str(app), *url(cluster))
    assert "RobotApp teleop of the files was left out: kubectl robotapp what-if --app FILE says where" in text
    for kind in ("Pod", "Node"):
        app.write_text(f"{{kind: {kind}, metadata: {{name: other}}}}")
        assert "left out" not in cluster.text("simulate", str(app), *url(cluster))


def test_the_cluster_is_sent_without_what_no_rule_reads(cluster: Stage) -> None:
    cluster.text("simulate", *url(cluster))
    body = sent(cluster)
    assert [(item["kind"], item["metadata"]["name"]) for item in body["items"]] == [("Node", "n1"), ("Pod", "p")]
    assert "secret" not in json.dumps(body)
    assert "kubelet" not in json.dumps(body)
    assert "config" not in body


SECRET_ENV = [{"name": "PASSWORD", "value": "hunter2"}]
SECRETIVE = [
    {
        "kind": "Pod",
        "metadata": {"annotations": {"kubectl.kubernetes.io/last-applied-configuration": "hunter2"}},
        "spec": {"ephemeralContainers": [{"name": "debug", "env": SECRET_ENV}]},
    },
    {"kind": "Deployment", "metadata": {}, "spec": {"template": {"spec": {"containers": [{"env": SECRET_ENV}]}}}},
    {
        "kind": "RobotApp",
        "metadata": {},
        "spec": {
            "components": [
                {"name": "a", "env": SECRET_ENV, "args": ["hunter2"], "template": {"spec": {"volumes": ["hunter2"]}}}
            ]
        },
    },
]


@pytest.mark.parametrize("obj", SECRETIVE, ids=lambda obj: obj["kind"])
def test_no_kind_is_sent_with_an_environment_a_command_or_what_was_applied(obj: Json) -> None:
    found = thinned(copy.deepcopy(obj))
    assert "hunter2" not in json.dumps(found)
    assert found["kind"] == obj["kind"]


def test_of_a_container_is_sent_what_nodes_must_be_able_to_do() -> None:
    options = {"name": "key", "mountPath": "/hunter2", "bindMountOptions": ["noexec"]}
    plain = {"name": "data", "mountPath": "/hunter2"}
    rules = [{"action": "RestartAllContainers"}]
    containers = [
        {"name": "a", "volumeMounts": [plain, options], "restartPolicyRules": rules},
        {"volumeMounts": [plain]},
    ]
    found = thinned({"kind": "Pod", "metadata": {}, "spec": {"containers": containers}})
    kept = {"name": "a", "volumeMounts": [{"bindMountOptions": ["noexec"]}], "restartPolicyRules": rules}
    assert found["spec"]["containers"] == [kept, {}]


def test_of_a_component_is_sent_what_the_scheduler_decodes() -> None:
    fields = [field.encode_name for field in msgspec.structs.fields(Component)]
    component = dict.fromkeys(fields, "kept") | {"image": "not"}
    found = thinned({"kind": "RobotApp", "metadata": {}, "spec": {"components": [component]}})
    assert found["spec"]["components"] == [dict.fromkeys(fields, "kept")]


@pytest.mark.parametrize(
    "spec", [None, 7, {"containers": 7}, {"containers": ["x", {"env": 1}]}, {"components": {"name": "a"}}]
)
def test_a_file_of_another_shape_is_sent_to_be_refused(cluster: Stage, tmp_path: Path, spec: object) -> None:
    (tmp_path / "odd.yaml").write_text(yaml.safe_dump({"kind": "Pod", "metadata": {"name": "odd"}, "spec": spec}))
    cluster.text("simulate", "--offline", str(tmp_path / "odd.yaml"), *url(cluster))
    assert [item["metadata"]["name"] for item in sent(cluster)["items"]] == ["odd"]


def test_a_date_in_a_file_stays_text_as_kubectl_reads_it(cluster: Stage, tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text("kind: Pod\nmetadata: {name: a, annotations: {since: 2026-01-01}}\n")
    cluster.text("simulate", "--offline", str(tmp_path / "a.yaml"), *url(cluster))
    (pod,) = json.loads(cluster.scheduler.posted[-1])["items"]
    assert pod["metadata"]["annotations"] == {"since": "2026-01-01"}


def test_pods_of_files_are_added_in_the_users_namespace(cluster: Stage, tmp_path: Path) -> None:
    one, two = {"kind": "Pod", "metadata": {"name": "a"}}, {"kind": "Pod", "metadata": {"name": "b", "namespace": "x"}}
    (tmp_path / "a.yaml").write_text(yaml.safe_dump_all([one, None]))
    (tmp_path / "b.json").write_text(json.dumps({"kind": "List", "items": [two]}))
    cluster.text("simulate", "--offline", str(tmp_path / "a.yaml"), str(tmp_path / "b.json"), *url(cluster))
    assert [(item["metadata"]["namespace"], item["metadata"]["name"]) for item in sent(cluster)["items"]] == [
        ("fleet", "a"),
        ("x", "b"),
    ]


def test_another_configuration_and_a_replay_are_passed_on(cluster: Stage, tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text("kind: KubeSchedulerConfiguration\n")
    moved = {**PLACED, "was": "n2"}
    cluster.scheduler.outcome = {**ANSWER, "placements": [moved], "moved": 1}
    text = cluster.text("simulate", "--config", str(tmp_path / "c.yaml"), "--replay", "5", *url(cluster))
    assert sent(cluster)["config"] == {"kind": "KubeSchedulerConfiguration"}
    assert cluster.scheduler.queries == ["replay=5"]
    assert text.splitlines()[0].split() == ["NAMESPACE", "POD", "NODE", "WAS", "WHY"]
    assert "1 pods placed again would be elsewhere" in text


def test_programs_get_the_schedulers_own_answer(cluster: Stage) -> None:
    assert cluster.data("simulate", *url(cluster)) == ANSWER


@pytest.mark.parametrize(
    ("status", "error", "said"),
    [
        (403, {"error": "you may not post /simulate"}, "answers 403 you may not post /simulate"),
        (400, {"error": "the configuration cannot be used", "problems": ["typo: x"]}, "cannot be used; typo: x"),
        (404, {"error": "no"}, "an older scheduler?"),
    ],
)
def test_a_refusal_is_quoted_and_ends_with_1(cluster: Stage, status: int, error: Json, said: str) -> None:
    cluster.scheduler.status, cluster.scheduler.refusal = status, error
    result = cluster.run("simulate", *url(cluster))
    assert result.exit_code == 1
    assert said in result.stderr


def test_a_user_who_may_not_read_all_of_it_is_told_of_the_role_that_may(cluster: Stage) -> None:
    cluster.api.failing.append(403)
    result = cluster.run("simulate", *url(cluster))
    assert (result.exit_code, cluster.scheduler.posted) == (1, [])
    assert "simulate reads 2 kinds of the whole cluster" in result.stderr
    assert "docs/simulate.md, section Rights" in result.stderr


@pytest.mark.parametrize("text", ["a: [", "- 1", "kind: Pod", "kind: List\nitems: [3]"])
def test_a_file_that_holds_no_objects_is_wrong_usage(cluster: Stage, tmp_path: Path, text: str) -> None:
    (tmp_path / "bad.yaml").write_text(text)
    result = cluster.run("simulate", "--offline", str(tmp_path / "bad.yaml"), *url(cluster))
    assert result.exit_code == 2
    assert "bad.yaml" in result.stderr
    assert cluster.scheduler.posted == []


def test_a_file_that_is_not_there_and_two_configurations_are_wrong_usage(cluster: Stage, tmp_path: Path) -> None:
    assert cluster.run("simulate", str(tmp_path / "none"), *url(cluster)).exit_code == 2
    (tmp_path / "two.yaml").write_text("a: 1\n---\nb: 2\n")
    assert cluster.run("simulate", "--config", str(tmp_path / "two.yaml"), *url(cluster)).exit_code == 2


def test_a_dump_of_thousands_of_objects_is_read_as_json_and_not_by_the_yaml_parser(
    cluster: Stage, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dump = tmp_path / "cluster.json"
    items = [{"kind": "Node", "metadata": {"name": "robot \U0001f916"}}, {"kind": "Pod", "metadata": {"name": "p"}}]
    dump.write_text(json.dumps({"apiVersion": "v1", "kind": "List", "items": items}))
    monkeypatch.delattr(yaml, "load_all")
    cluster.text("simulate", "--offline", str(dump), *url(cluster))
    assert [item["metadata"]["name"] for item in sent(cluster)["items"]] == ["robot \U0001f916", "p"]
