"""The judge of the sweep notices a second live pod of an instance, and counts instances at once."""

from typing import Any

from campaigns.operating.sweep import APP, Report, count_live_pods, matrix
from campaigns.storm.history import Event
from robotapp_api.model.names import Label
from robotapp_api.values.sweeps.matrix import count_instances


def pod(uid: str, instance: str, *, node: str = "n", phase: str = "Running") -> dict[str, Any]:
    labels = {Label.APP.value: APP, Label.INSTANCE.value: instance}
    meta = {"name": uid, "uid": uid, "labels": labels}
    return {"metadata": meta, "spec": {"nodeName": node}, "status": {"phase": phase}}


def judged(*pods: tuple[dict[str, Any], bool]) -> Report:
    report = Report(2, 2)
    count_live_pods([Event(number, "Pod", gone, obj) for number, (obj, gone) in enumerate(pods, 10)], report)
    return report


def test_a_second_live_pod_of_an_instance_is_a_problem() -> None:
    report = judged((pod("a", "one"), False), (pod("b", "one", node=""), False), (pod("b", "one"), False))
    assert report.problems == ["revision 12: one has 2 live pods: ['a', 'b']"]


def test_a_successor_of_a_pod_that_has_ended_or_is_gone_is_none() -> None:
    ended, gone = (pod("a", "one", phase="Failed"), False), (pod("b", "one"), True)
    report = judged((pod("a", "one"), False), ended, (pod("b", "one"), False), gone, (pod("c", "one"), False))
    assert report.problems == []
    assert (report.pods, report.most_at_once) == (3, 1)


def test_instances_at_once_are_counted() -> None:
    assert judged((pod("a", "one"), False), (pod("b", "two"), False)).most_at_once == 2


def test_the_matrix_has_as_many_instances_as_are_asked_for() -> None:
    assert [count_instances(matrix(count, 1)) for count in (1, 7, 24, 200)] == [1, 7, 24, 200]
