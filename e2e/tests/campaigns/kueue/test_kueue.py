"""`scripts/bench kueue`: what it applies, and what it makes of the history of Jobs."""

from pathlib import Path
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from campaigns.kueue import manager
from campaigns.kueue.job_history import JobChange, judge, read_change
from campaigns.kueue.objects import JOBS, QUEUE, make_app, make_queue
from robotapp_api.model.names import QUEUE_NAME
from robotapp_testbed.control_plane.components import RUNS_FOR, STAGES_DIR

Json = dict[str, Any]


def change(revision: int, uid: str, *, suspended: bool = False, ended: bool = False, gone: bool = False) -> JobChange:
    return JobChange(revision, f"job-{uid}", uid, suspended, ended, gone)


def webhook(kind: str) -> Json:
    service = {"name": manager.WEBHOOKS, "namespace": manager.NAMESPACE, "path": "/x"}
    return {"kind": kind, "metadata": {"name": "x"}, "webhooks": [{"clientConfig": {"service": service}}]}


def test_the_release_is_applied_without_its_pod_and_its_webhooks_lead_to_a_port_of_this_machine() -> None:
    conversion = {"strategy": "Webhook", "webhook": {"clientConfig": {"service": {"name": manager.WEBHOOKS}}}}
    crd = {"kind": "CustomResourceDefinition", "metadata": {"name": "c"}, "spec": {"conversion": conversion}}
    plain_crd = {"kind": "CustomResourceDefinition", "metadata": {"name": "d"}, "spec": {}}
    pod = [{"kind": kind, "metadata": {"name": "x"}} for kind in ("Deployment", "Service", "APIService")]
    objects = manager.adapt([webhook("MutatingWebhookConfiguration"), crd, plain_crd, *pod], 4711)
    by_kind = {item["kind"]: item for item in objects}
    assert {"Deployment", "APIService"}.isdisjoint(by_kind)
    assert by_kind["MutatingWebhookConfiguration"]["webhooks"][0]["clientConfig"]["service"]["port"] == 4711
    assert objects[1]["spec"]["conversion"]["webhook"]["clientConfig"]["service"]["port"] == 4711
    assert by_kind["Service"]["spec"] == {"type": "ExternalName", "externalName": "localhost"}
    assert by_kind["Secret"]["metadata"]["name"] == manager.SECRET
    assert crd["spec"]["conversion"]["webhook"]["clientConfig"]["service"] == {"name": manager.WEBHOOKS}, "a copy"
    assert len([item for item in manager.adapt([*objects], 1) if item["kind"] == "Secret"]) == 1


def test_the_manager_queues_jobs_alone_and_has_its_certificate_from_a_folder(tmp_path: Path) -> None:
    content = manager.configure(webhook_port=1, health_port=2, certificates=tmp_path)
    assert content["integrations"]["frameworks"] == ["batch/job"]
    assert content["webhook"] == {"host": "127.0.0.1", "port": 1, "certDir": str(tmp_path)}


def test_four_jobs_wait_in_the_queue_of_their_namespace() -> None:
    sweep, components = make_app("a", "sweep", "pool"), make_app("a", "components", "pool")
    assert sweep["metadata"]["labels"] == {QUEUE_NAME: QUEUE}
    assert len(sweep["spec"]["matrix"]["parameters"][0]["values"]) == JOBS
    assert len(components["spec"]["components"]) == JOBS
    assert "matrix" not in components["spec"]
    flavor, cluster_queue, local_queue = make_queue("here")
    assert local_queue["spec"]["clusterQueue"] == cluster_queue["metadata"]["name"] == "here"
    assert cluster_queue["spec"]["resourceGroups"][0]["flavors"][0]["name"] == flavor["metadata"]["name"]


def test_simulated_pods_run_for_as_long_as_their_annotation_says() -> None:
    assert RUNS_FOR in (STAGES_DIR / "pod-complete.yaml").read_text()


def test_two_at_a_time_are_within_the_room_and_three_are_not() -> None:
    changes = [change(n, uid, suspended=True) for n, uid in enumerate("abc", 1)]
    changes += [change(11, "a"), change(12, "b")]
    assert judge([*changes, change(13, "a", ended=True), change(14, "c")], 2).problems == []
    verdict = judge([*changes, change(13, "c")], 2)
    assert verdict.most_at_once == 3
    assert verdict.problems == ["revision 13: 3 Jobs run, the queue has room for 2"]


def test_every_turn_of_suspend_is_counted_until_the_job_has_ended() -> None:
    changes = [
        change(1, "a", suspended=True),
        change(2, "a", suspended=True),
        change(3, "a"),
        change(4, "a", suspended=True),
        change(5, "a"),
        change(6, "a", ended=True),
        change(7, "a", gone=True),
        change(8, "b"),
    ]
    verdict = judge(changes, 2)
    assert [*verdict.turns.values()] == [[True, False, True, False], [False]]
    assert verdict.problems == ["job-b was created without being suspended"]


@given(st.lists(st.tuples(st.sampled_from("abcd"), st.booleans()), max_size=30))
def test_the_order_in_which_changes_are_given_does_not_matter(states: list[tuple[str, bool]]) -> None:
    changes = [change(number, uid, suspended=suspended) for number, (uid, suspended) in enumerate(states)]
    assert judge(changes, 2) == judge(changes[::-1], 2)


def test_a_job_ends_with_a_condition_that_is_true() -> None:
    job = {"metadata": {"resourceVersion": "7", "name": "j", "uid": "u"}, "spec": {"suspend": True}}
    assert read_change({"type": "ADDED", "object": job}) == JobChange(7, "j", "u", is_suspended=True, has_ended=False)
    ended = {**job, "spec": {}, "status": {"conditions": [{"type": "Complete", "status": "True"}]}}
    assert read_change({"type": "DELETED", "object": ended}) == JobChange(7, "j", "u", False, True, is_gone=True)
