"""Old workloads give way to an app, and come back when it does not become Ready."""

from typing import Any

import pytest
from tests.support.fake_cluster import FakeCluster, app

from rigel_bridge.cluster.kubectl import ClusterError, Refusal
from rigel_bridge.cluster.takeover import Limits, annotate, read, restorable, take_over
from rigel_bridge.cluster.waiting import Clock

LIMITS = Limits(gone_s=5, ready_s=5)


def clock() -> Clock:
    now = [0.0]
    return Clock(now_s=lambda: now[0], sleep=lambda seconds: now.__setitem__(0, now[0] + seconds))


def old() -> dict[str, Any]:
    metadata = {"name": "arm", "namespace": "fleet", "uid": "u", "resourceVersion": "7", "labels": {"app": "arm"}}
    return {"apiVersion": "apps/v1", "kind": "Deployment", "metadata": metadata, "spec": {"replicas": 1}, "status": {}}


def cluster(*, ready: bool) -> FakeCluster:
    made = FakeCluster()
    made.objects["deployment", "arm"] = old()

    def operate(_: tuple[str, ...]) -> None:
        stored = made.objects.get(("robotapps", "arm"))
        if stored:
            state = {"type": "Ready", "status": str(ready), "observedGeneration": 1}
            stored["status"] = {"conditions": [state]}

    made.before = operate
    return made


def test_the_old_workload_is_gone_before_the_app_begins() -> None:
    made = cluster(ready=True)
    take_over(made, app("arm"), [old()], limits=LIMITS, clock=clock(), tell=str)
    verbs = [call[:3] for call in made.calls]
    gone = verbs.index(("get", "deployment", "arm"))
    written = [n for n, call in enumerate(made.calls) if call[0] == "apply" and "--dry-run=server" not in call]
    assert verbs.index(("delete", "deployment", "arm")) < gone < written[0]
    assert ("deployment", "arm") not in made.objects


def test_an_app_that_does_not_become_ready_gives_way_to_what_was_there() -> None:
    made, told = cluster(ready=False), list[str]()
    with pytest.raises(ClusterError, match="is not Ready"):
        take_over(made, app("arm"), [old()], limits=LIMITS, clock=clock(), tell=told.append)
    assert ("robotapps", "arm") not in made.objects
    assert made.objects["deployments", "arm"]["spec"] == {"replicas": 1}
    assert "the old workloads come back" in " ".join(told)


def test_nothing_is_deleted_for_an_app_that_the_server_refuses_or_that_is_there() -> None:
    made = cluster(ready=True)
    made.refused["apply", "robotapps"] = Refusal.INVALID
    with pytest.raises(ClusterError):
        take_over(made, app("arm"), [old()], limits=LIMITS, clock=clock(), tell=str)
    made.refused.clear()
    made.objects["robotapps", "arm"] = {**app("arm"), "metadata": {"name": "arm", "uid": "x", "generation": 1}}
    with pytest.raises(ClusterError, match="is there already"):
        take_over(made, app("arm"), [old()], limits=LIMITS, clock=clock(), tell=str)
    assert "delete" not in {call[0] for call in made.calls}


def test_what_is_created_again_has_nothing_of_the_servers_own() -> None:
    assert restorable(old()) == {
        "apiVersion": "apps/v1",
        "kind": "Deployment",
        "metadata": {"name": "arm", "namespace": "fleet", "labels": {"app": "arm"}},
        "spec": {"replicas": 1},
    }


def test_what_the_user_may_not_see_or_write_is_told() -> None:
    made, told = cluster(ready=True), list[str]()
    made.refused["get", "nodes"] = Refusal.FORBIDDEN
    made.refused["annotate", "node"] = Refusal.FORBIDDEN
    read(made, everywhere=False, tell=told.append)
    annotate(made, "n1", "scheduler.robotics.io/dds-claims-", tell=told.append)
    assert told[0].startswith("nodes are not looked at")
    assert told[1] == "for an admin: kubectl annotate node n1 'scheduler.robotics.io/dds-claims-' --overwrite"
