"""Old workloads give way to an app, and come back when it does not become Ready."""

import shlex
from pathlib import Path
from typing import Any

import pytest
from tests.unit.bridge.fake_cluster import FakeCluster, app

from rigel_bridge.cluster.kubectl import ClusterError, Refusal
from rigel_bridge.cluster.takeover import Limits, annotate, read, restorable, take_over
from rigel_bridge.cluster.waiting import Clock
from rigel_bridge.migration.found import config_maps_of
from rigel_bridge.migration.report import annotation

LIMITS = Limits(gone_s=5, ready_s=5)


def clock() -> Clock:
    now = [0.0]
    return Clock(now_s=lambda: now[0], sleep=lambda seconds: now.__setitem__(0, now[0] + seconds))


def old() -> dict[str, Any]:
    metadata = {"name": "arm", "namespace": "fleet", "uid": "u", "resourceVersion": "7", "labels": {"app": "arm"}}
    return {"apiVersion": "apps/v1", "kind": "Deployment", "metadata": metadata, "spec": {"replicas": 1}, "status": {}}


def cluster(*, ready: bool) -> FakeCluster:
    made = FakeCluster()
    made.objects["deployments", "arm"] = old()

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
    assert ("deployments", "arm") not in made.objects


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
    made.objects["robotapps", "arm"] = {
        **app("arm"),
        "metadata": {"name": "arm", "namespace": "fleet", "uid": "x", "generation": 1},
    }
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
    made.refused["annotate", "nodes"] = Refusal.FORBIDDEN
    read(made, everywhere=False, tell=told.append)
    annotate(made, "n1", ["scheduler.robotics.io/dds-claims-"], version="7", tell=told.append)
    assert told[0].startswith("nodes are not looked at")
    assert told[1] == "for an admin: kubectl annotate node n1 scheduler.robotics.io/dds-claims- --overwrite"


def test_config_maps_with_variables_of_a_workload_are_read_and_no_others() -> None:
    made = cluster(ready=True)
    pod = {"containers": [{"name": "c", "image": "ros:humble", "envFrom": [{"configMapRef": {"name": "ros-env"}}]}]}
    made.objects["deployments", "talker"] = old() | {
        "metadata": {"name": "talker", "namespace": "fleet"},
        "spec": {"template": {"spec": pod}},
    }
    for name in ("ros-env", "web"):
        metadata = {"name": name, "namespace": "fleet"}
        made.objects["configmaps", name] = {"kind": "ConfigMap", "metadata": metadata, "data": {"ROS_DOMAIN_ID": "5"}}
    objects = read(made, everywhere=False, tell=pytest.fail, config_maps_of=config_maps_of)
    assert [each["metadata"]["name"] for each in objects if each["kind"] == "ConfigMap"] == ["ros-env"]


def test_a_command_for_an_admin_runs_nothing_that_a_record_holds() -> None:
    made, told = cluster(ready=True), list[str]()
    made.refused["annotate", "nodes"] = Refusal.FORBIDDEN
    argument = annotation("device-claims", {"can'; touch owned; '": "u"})
    annotate(made, "n1", [argument], version="7", tell=told.append)
    words = shlex.split(told[0].partition(": ")[2])
    assert words == ["kubectl", "annotate", "node", "n1", argument, "--overwrite"]


class Terminating:
    """A Deployment of which a part is gone when its pods are: until then it is there, and takes what is written to it along."""

    def __init__(self, made: FakeCluster, *, looks: int) -> None:
        self.made, self.left, self.ended = made, looks, False
        self.operate = made.before
        made.before = self.before

    def before(self, call: tuple[str, ...]) -> None:
        self.operate(call)
        if call[:3] == ("delete", "deployment", "arm"):
            self.ended = True
        elif self.ended and call[:3] == ("get", "deployment", "arm"):
            self.left -= 1
            if self.left > 0:
                metadata = {**old()["metadata"], "deletionTimestamp": "2026-01-01T00:00:00Z"}
                self.made.objects["deployments", "arm"] = {**old(), "metadata": metadata}
            else:
                self.made.objects.pop(("deployments", "arm"), None)


def test_ctrl_c_while_the_old_workload_ends_brings_it_back_after_it_is_gone() -> None:
    made = cluster(ready=True)
    ending = Terminating(made, looks=5)
    passing = clock()

    def interrupted(seconds: float) -> None:
        passing.sleep(seconds)
        if ending.left == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        take_over(
            made, app("arm"), [old()], limits=LIMITS, clock=Clock(now_s=passing.now_s, sleep=interrupted), tell=str
        )
    verbs = [call[0] for call in made.calls if "--dry-run=server" not in call]
    assert ending.left == 0, "the write to what was being deleted would have been lost"
    assert verbs[-1] == "apply"
    assert made.objects["deployments", "arm"]["spec"] == {"replicas": 1}


def test_an_old_workload_that_does_not_end_is_told_with_its_copy() -> None:
    made, told = cluster(ready=True), list[str]()
    Terminating(made, looks=10_000)
    with pytest.raises(ClusterError, match="is not gone after 5 s"):
        take_over(made, app("arm"), [old()], limits=LIMITS, clock=clock(), tell=told.append, backup=Path("my backup"))
    assert "deployment arm is not restored: kubectl: it is still being deleted" in told[-1]
    assert "kubectl apply --server-side -f 'my backup/deployment-arm.json'" in told[-1]
    assert {call for call in made.calls if call[0] == "apply" and "--dry-run=server" not in call} == set()


def test_pods_of_the_app_that_stay_keep_the_old_workloads_away_and_that_is_told() -> None:
    made, told = cluster(ready=False), list[str]()
    labels = {"robotics.io/app-uid": "uid-arm"}
    made.objects["pods", "p"] = {"metadata": {"name": "p", "labels": labels}}
    with pytest.raises(ClusterError, match="is not Ready"):
        take_over(made, app("arm"), [old()], limits=LIMITS, clock=clock(), tell=told.append)
    assert "there still are pods/p" in told[-2]
    assert "deployment arm is not restored" in told[-1]


def test_one_old_workload_that_is_refused_leaves_the_others() -> None:
    made, told = cluster(ready=False), list[str]()
    pod = {**old(), "apiVersion": "v1", "kind": "Pod", "metadata": {**old()["metadata"], "name": "lidar"}}
    made.objects["pods", "lidar"] = pod
    made.refused["apply", "pods"] = Refusal.FORBIDDEN
    with pytest.raises(ClusterError, match="is not Ready"):
        take_over(made, app("arm"), [pod, old()], limits=LIMITS, clock=clock(), tell=told.append)
    assert "pod lidar is not restored: kubectl: apply pods is refused" in told[-1]
    assert ("deployments", "arm") in made.objects
