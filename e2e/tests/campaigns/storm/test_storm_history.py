"""The judge of the storm sees what was wrong at any revision, in whatever order the events of two watches came."""

import random
from typing import Any

from campaigns.storm.history import Event, Judge
from robotapp_api.model.names import Label

Object = dict[str, Any]


def pod(name: str, *, app: str, domain: str, phase: str = "Running") -> Object:
    labels = {str(Label.APP_UID): app}
    variables = [{"name": "ROS_DOMAIN_ID", "value": domain}]
    return {
        "metadata": {"name": name, "uid": f"uid-{name}", "namespace": "ours", "labels": labels},
        "spec": {"nodeName": "n", "containers": [{"env": variables}]},
        "status": {"phase": phase},
    }


def claim(number: int, *, app: str, uid: str = "c") -> Object:
    meta = {"name": f"dds.default.c.{number}", "uid": uid}
    return {"metadata": meta, "spec": {"domain": {"id": number}, "holder": {"uid": app}}}


def broken(*found: tuple[str, Object, bool]) -> list[str]:
    events = [Event(revision, kind, gone, obj) for revision, (kind, obj, gone) in enumerate(found, start=1)]
    cut = len(events) // 2
    judge = Judge(namespaces={"ours"})
    for part in (events[:cut], events[cut:]):
        random.Random(1).shuffle(part)
        judge.hear(part)
    return judge.verdict.broken


def test_a_claim_and_its_pod_one_after_the_other_are_well() -> None:
    history = (
        ("RobotClaim", claim(7, app="a"), False),
        ("Pod", pod("p", app="a", domain="7"), False),
        ("Pod", pod("p", app="a", domain="7"), True),
        ("RobotClaim", claim(7, app="a"), True),
        ("RobotClaim", claim(7, app="b", uid="d"), False),
        ("Pod", pod("q", app="b", domain="7"), False),
    )
    assert broken(*history) == []


def test_a_claim_that_goes_under_a_running_pod_is_seen_although_all_is_well_in_the_end() -> None:
    (text,) = broken(
        ("RobotClaim", claim(7, app="a"), False),
        ("Pod", pod("p", app="a", domain="7"), False),
        ("RobotClaim", claim(7, app="a"), True),
        ("Pod", pod("p", app="a", domain="7"), True),
    )
    assert text.startswith("revision 3, grant 1: p of")


def test_two_users_of_a_domain_at_one_revision_are_seen() -> None:
    found = broken(
        ("RobotClaim", claim(7, app="a"), False),
        ("Pod", pod("p", app="a", domain="7"), False),
        ("Pod", pod("q", app="b", domain="7"), False),
        ("Pod", pod("q", app="b", domain="7"), True),
    )
    assert any("7 is used by" in text for text in found)


def test_a_pod_that_ended_uses_nothing() -> None:
    ended = pod("p", app="a", domain="7", phase="Succeeded")
    assert broken(("RobotClaim", claim(7, app="b"), False), ("Pod", ended, False)) == []


def test_a_stranger_s_pod_may_not_even_be_bound() -> None:
    event = Event(5, "Pod", False, pod("p", app="a", domain="7"))
    judge = Judge(namespaces=set(), strangers={"ours"})
    judge.hear([event])
    assert judge.verdict.broken == ["revision 5, grant 0: forged pod p was bound"]
