"""Groups of which enough pods were seen bound: told once, and only while it is about the group that is there."""

from tests.support.scheduler.pod_groups import announce, arrive, depart, pod_group, team_pod
from tests.support.scheduling import make_core

from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.pods.pod_group_index import COSCHEDULING, GroupRef


def three() -> list[Pod]:
    return [team_pod(f"p{i}", node="n0") for i in range(3)]


def test_a_group_that_became_whole_is_told_with_its_uid_unless_it_or_all_its_pods_are_gone() -> None:
    core = make_core()
    groups = core.cluster.pod_groups
    ref = GroupRef(COSCHEDULING, "default", "team")
    first = pod_group()
    first.metadata.uid = "first"
    announce(core, first)
    arrive(core, *three())
    assert groups.take_completed() == [(ref, "first")]
    assert groups.take_completed() == []
    depart(core, *three())
    arrive(core, *three())
    depart(core, *three())
    assert groups.take_completed() == [], "all its pods are gone"
    arrive(core, *three())
    groups.remove(first, COSCHEDULING)
    assert groups.take_completed() == [], "the group is gone"
