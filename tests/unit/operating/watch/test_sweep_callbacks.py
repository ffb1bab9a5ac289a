"""What the sweep asks of the operator, and what it tells."""

from tests.support.factories import make_pod

from robotapp_claims.rules.identity import holder_of_app, holder_of_pod
from robotapp_claims.rules.objects import Holder
from robotapp_claims.rules.repair import ClaimConflict
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.sweep_callbacks import Conflicts, granted_pods

TELEOP = holder_of_app(namespace="team", name="teleop", uid="uid-1", instance="amr-07")
THIEF = holder_of_app(namespace="other", name="thief", uid="uid-2")
BARE = holder_of_pod(namespace="team", name="bare", uid="uid-3")


def conflict(runs: Holder, holds: Holder, thing: str = "domain 7 of default") -> ClaimConflict:
    return ClaimConflict(runs=runs, holds=holds, claim="dds.default.c.7", thing=thing)


def test_both_apps_are_told_in_words_for_their_own_namespace() -> None:
    changed: list[tuple[str, str]] = []
    conflicts = Conflicts(lambda uid, instance: changed.append((uid, instance)))
    conflicts.take([conflict(TELEOP, THIEF)])
    assert sorted(changed) == [("uid-1", "amr-07"), ("uid-2", "")]
    assert "held by another namespace, but team/teleop (amr-07) runs with it" in conflicts.of("uid-1")
    assert "held by other/thief, but another namespace runs with it" in conflicts.of("uid-2")


def test_only_changes_are_news_and_the_end_of_a_conflict_is_one() -> None:
    changed: list[tuple[str, str]] = []
    conflicts = Conflicts(lambda uid, instance: changed.append((uid, instance)))
    for _ in range(2):
        conflicts.take([conflict(TELEOP, THIEF)])
    assert len(changed) == 2
    conflicts.take([])
    assert sorted(changed[2:]) == [("uid-1", "amr-07"), ("uid-2", "")]
    assert conflicts.of("uid-1") == ""


def test_several_conflicts_are_counted_and_a_pod_has_no_status_of_ours() -> None:
    changed: list[tuple[str, str]] = []
    conflicts = Conflicts(lambda uid, instance: changed.append((uid, instance)))
    conflicts.take([conflict(TELEOP, BARE, f"can-can{number} on edge-1") for number in range(3)])
    assert changed == [("uid-1", "amr-07")]
    assert conflicts.of("uid-1").startswith("can-can0 on edge-1 is held by pod team/bare")
    assert conflicts.of("uid-1").endswith("(and 2 more)")


def test_an_instance_is_told_of_its_own_conflicts_alone() -> None:
    other = holder_of_app(namespace="team", name="teleop", uid="uid-1", instance="amr-08")
    conflicts = Conflicts(lambda _uid, _instance: None)
    conflicts.take([conflict(TELEOP, THIEF), conflict(other, THIEF, "domain 8 of default")])
    assert conflicts.of("uid-1").endswith("(and 1 more)")
    assert conflicts.of("uid-1", "amr-08").startswith("domain 8")
    assert conflicts.of("uid-1", "amr-09") == ""


def test_bare_pods_with_grants_are_shown_to_the_sweep() -> None:
    cache = Cache()
    grants = {"annotations": {"granted.robotics.io/dds-domain": "7"}}
    cache.bare_pods.put("team", "team/granted", make_pod("granted", node="edge-1", metadata=grants))
    cache.bare_pods.put("team", "team/plain", make_pod("plain", node="edge-1"))
    (found,) = granted_pods(cache)
    assert (found.metadata.name, found.spec.node_name, found.status.phase) == ("granted", "edge-1", "Running")
