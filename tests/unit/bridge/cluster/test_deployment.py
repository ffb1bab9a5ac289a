"""apply and rollback against a cluster in memory."""

from collections.abc import Callable
from typing import Any

import pytest
from tests.unit.bridge.fake_cluster import FakeCluster, app

from rigel_bridge.cluster.deployment import Proposal, deploy, roll_back
from rigel_bridge.cluster.kubectl import ClusterError, Refusal
from rigel_bridge.document.failures import Exit


def approve_all(proposal: Proposal) -> None:
    assert proposal.diff.startswith("--- cluster/teleop\n+++ revision/"), "the difference is there to be shown"


def silent(line: str) -> None:
    raise AssertionError(line)


def numbers(cluster: FakeCluster) -> list[int]:
    return sorted(each["revision"] for each in cluster.revisions())


def test_a_first_apply_creates_and_a_second_changes_nothing() -> None:
    cluster = FakeCluster()
    assert deploy(cluster, app(), tell=silent).outcome == "created"
    assert deploy(cluster, app(), tell=silent).outcome == "unchanged"
    assert numbers(cluster) == [1]


def test_a_change_names_its_fields_and_a_hand_made_spec_is_kept_before_it_goes() -> None:
    cluster = FakeCluster()
    deploy(cluster, app(update={"operator": "Automatic"}), tell=silent)
    cluster.objects["robotapps", "teleop"]["spec"] = {"ros": {"distro": "jazzy"}}
    written = deploy(cluster, app(), tell=silent)
    assert written.changes == ("spec.ros.distro: jazzy -> humble",)
    assert [each["data"]["spec"]["ros"]["distro"] for each in cluster.revisions()] == ["humble", "jazzy", "humble"]


def test_a_rollback_also_undoes_what_others_wrote_since() -> None:
    cluster = FakeCluster()
    first: dict[str, Any] = deploy(cluster, app(), tell=silent).stored["spec"]
    deploy(cluster, app(schedulerName="x"), tell=silent)
    cluster.objects["robotapps", "teleop"]["spec"]["suspend"] = True
    written, number = roll_back(cluster, "teleop", number=1, approve=approve_all, tell=silent)
    assert (written.stored["spec"], number) == (first, 1)
    assert [call[0] for call in cluster.calls].count("replace") == 1
    back, _ = roll_back(cluster, "teleop", number=None, approve=approve_all, tell=silent)
    assert back.stored["spec"]["suspend"] is True, "the spec of before the rollback"


def test_a_rollback_that_is_not_approved_writes_nothing() -> None:
    cluster = FakeCluster()
    deploy(cluster, app(), tell=silent)
    deploy(cluster, app(schedulerName="x"), tell=silent)
    planted = cluster.revisions()[0]
    container = {"name": "driver", "image": "evil:1", "template": {"spec": {"serviceAccountName": "deployer"}}}
    planted["data"] = {"spec": {**app()["spec"], "components": [container]}}
    seen: list[Proposal] = []

    def refuse(proposal: Proposal) -> None:
        seen.append(proposal)
        raise ClusterError("nobody said yes")

    before = cluster.objects["robotapps", "teleop"]["spec"]
    with pytest.raises(ClusterError, match="nobody said yes"):
        roll_back(cluster, "teleop", number=1, approve=refuse, tell=silent)
    assert cluster.objects["robotapps", "teleop"]["spec"] == before
    assert seen[0].additions == (
        "component driver: ServiceAccount deployer",
        "component driver: image evil:1",
    )
    assert "+      serviceAccountName: deployer" in seen[0].diff


def rolled_back_while(change: Callable[[dict[str, Any]], None]) -> None:
    """A rollback that needs a replacement, before which somebody else writes once."""
    cluster = FakeCluster()
    deploy(cluster, app(), tell=silent)
    deploy(cluster, app(schedulerName="x"), tell=silent)
    stored = cluster.objects["robotapps", "teleop"]
    stored["spec"]["suspend"] = True

    def before(call: tuple[str, ...]) -> None:
        now = cluster.objects["robotapps", "teleop"]
        if call[0] == "replace" and now["metadata"]["resourceVersion"] != "0":
            now["metadata"]["resourceVersion"] = "0"
            change(now)

    cluster.before = before
    assert roll_back(cluster, "teleop", number=1, approve=approve_all, tell=silent)[0].stored["spec"] == app()["spec"]


def test_a_status_written_meanwhile_does_not_stop_a_rollback_and_a_spec_does() -> None:
    rolled_back_while(lambda now: now.update(status={"phase": "Running"}))
    with pytest.raises(ClusterError, match="being changed by somebody else"):
        rolled_back_while(lambda now: now["metadata"].update(generation=99))


def test_an_app_that_is_not_there_and_a_revision_that_is_not_there_have_a_code_of_their_own() -> None:
    cluster = FakeCluster()
    with pytest.raises(ClusterError, match="there is no RobotApp teleop") as missing:
        roll_back(cluster, "teleop", number=None, approve=approve_all, tell=silent)
    deploy(cluster, app(), tell=silent)
    with pytest.raises(ClusterError, match="no earlier spec") as nowhere:
        roll_back(cluster, "teleop", number=None, approve=approve_all, tell=silent)
    assert missing.value.code == nowhere.value.code == Exit.MISSING


def test_without_the_right_to_keep_a_history_apply_goes_on_and_tells_it() -> None:
    cluster, told = FakeCluster(), list[str]()
    cluster.refused["create", "controllerrevisions"] = Refusal.FORBIDDEN
    assert deploy(cluster, app(), tell=told.append).outcome == "created"
    assert "robotapp-editor" in told[0]
    cluster.refused["create", "controllerrevisions"] = Refusal.OTHER
    with pytest.raises(ClusterError):
        deploy(cluster, app(), tell=silent)


def test_two_writers_at_once_get_two_numbers() -> None:
    cluster = FakeCluster()
    deploy(cluster, app(), tell=silent)
    (other,) = cluster.revisions()

    def meanwhile(call: tuple[str, ...]) -> None:
        if call[0] == "create" and ("controllerrevisions", "teleop-2") not in cluster.objects:
            rival = {
                **other,
                "metadata": {**other["metadata"], "name": "teleop-2"},
                "revision": 2,
                "data": {"spec": {}},
            }
            cluster.objects["controllerrevisions", "teleop-2"] = rival

    cluster.before = meanwhile
    deploy(cluster, app(schedulerName="x"), tell=silent)
    assert numbers(cluster) == [1, 2, 3]
