"""VolumeBinding: what it answers, in upstream's words."""

from typing import Any

import pytest
from tests.support.scheduler.volume_worlds import Json, decide, refusals, scores, world
from tests.support.scheduler.volumes import (
    make_capacity,
    make_claim,
    make_class,
    make_driver,
    make_volume,
    mounting,
)

from robotapp_scheduler.core.framework.interface import Code
from robotapp_scheduler.core.pods.pod_info import PodInfo

NOT_MATCHED = "node(s) didn't match PersistentVolume's node affinity"
NONE_FREE = "node(s) didn't find available persistent volumes to bind"
NO_SPACE = "node(s) did not have enough free storage"
GONE = "node(s) unavailable due to one or more pvc(s) bound to non-existent pv(s)"
IN_USE = (
    "node(s) unavailable due to PersistentVolumeClaim with ReadWriteOncePod access mode already in-use by another pod"
)


# --- Refused as a whole -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("objects", "pod", "text"),
    [
        ([], mounting("map"), 'persistentvolumeclaim "map" not found'),
        (
            [],
            mounting(ephemeral=["scratch"]),
            'waiting for ephemeral volume controller to create the persistentvolumeclaim "p-scratch"',
        ),
        (
            [make_class(), make_claim("p-scratch", owner="somebody")],
            mounting(ephemeral=["scratch"]),
            "PVC default/p-scratch was not created for pod default/p (pod is not owner)",
        ),
        (
            [make_claim("map", volume="v", phase="Lost")],
            mounting("map"),
            'persistentvolumeclaim "map" bound to non-existent persistentvolume "v"',
        ),
        ([make_claim("map", deleting=True)], mounting("map"), 'persistentvolumeclaim "map" is being deleted'),
        (
            [make_class(waits=False), make_claim("map")],
            mounting("map"),
            "pod has unbound immediate PersistentVolumeClaims",
        ),
        ([make_claim("map")], mounting("map"), "pod has unbound immediate PersistentVolumeClaims"),
        (
            [make_class(), make_volume("v"), make_claim("map", volume="v", bound=False)],
            mounting("map"),
            "pod has unbound immediate PersistentVolumeClaims",
        ),
        ([make_claim("map", volume="v")], mounting("map"), 'persistentvolume "v" not found'),
    ],
)
def test_a_pod_whose_claims_cannot_be_followed_is_refused_at_once(objects: list[Any], pod: PodInfo, text: str) -> None:
    decision = decide(world(*objects), pod)
    assert decision.code is Code.UNRESOLVABLE
    assert decision.message == f"0/3 nodes are available: {text}. not found"


def test_the_claim_of_another_namespace_does_not_count() -> None:
    decision = decide(world(make_class(), make_claim("map", namespace="other")), mounting("map"))
    assert 'persistentvolumeclaim "map" not found' in decision.message


# --- Bound claims -----------------------------------------------------------------------------------------------------


def test_a_bound_claim_keeps_the_pod_on_the_nodes_that_reach_its_volume() -> None:
    core = world(make_volume("v", on=["n1"]), make_claim("map", volume="v"))
    assert refusals(core, mounting("map")) == [(NOT_MATCHED,), (), (NOT_MATCHED,)]
    assert decide(core, mounting("map")).volumes is None


def test_a_volume_without_affinity_is_reached_from_everywhere_and_fields_never_name_a_node() -> None:
    fields = {"matchFields": [{"key": "metadata.name", "operator": "In", "values": ["n1"]}]}
    negative = {"matchFields": [{"key": "metadata.name", "operator": "NotIn", "values": ["n1"]}]}
    for affinity, feasible in (
        (None, 3),
        ({"required": {"nodeSelectorTerms": [fields]}}, 0),
        ({"required": {"nodeSelectorTerms": [negative]}}, 3),
        ({"required": {"nodeSelectorTerms": []}}, 0),
    ):
        core = world(make_volume("v", affinity=affinity), make_claim("map", volume="v"))
        assert sum(not texts for texts in refusals(core, mounting("map"))) == feasible


def test_the_volume_of_an_ephemeral_claim_that_vanished_is_named_node_by_node() -> None:
    core = world(make_claim("p-scratch", volume="v", owner="uid-p"))
    assert refusals(core, mounting(ephemeral=["scratch"])) == [(GONE,)] * 3


def test_both_a_wrong_node_and_a_lacking_volume_are_reported() -> None:
    core = world(
        make_class(provisioner="kubernetes.io/no-provisioner"),
        make_volume("v", on=["n0"], phase="Bound", claim={"namespace": "default", "name": "map", "uid": "claim-map"}),
        make_claim("map", volume="v"),
        make_claim("log"),
    )
    assert refusals(core, mounting("map", "log")) == [(NONE_FREE,), (NOT_MATCHED, NONE_FREE), (NOT_MATCHED, NONE_FREE)]


# --- Claims that wait for the scheduler ----------------------------------------------------------------------------------


def test_the_smallest_volume_that_fits_is_given_and_nodes_without_one_are_refused() -> None:
    core = world(
        make_class(provisioner="kubernetes.io/no-provisioner"),
        make_volume("big", size="20Gi", on=["n0", "n1"]),
        make_volume("small", size="10Gi", on=["n1"]),
        make_volume("tiny", size="1Gi", on=["n2"]),
        make_claim("map", size="5Gi"),
    )
    assert refusals(core, mounting("map")) == [(), (), (NONE_FREE,)]
    assert scores(core, mounting("map")) == [75, 50]
    for zone, given in (("a", "big"), ("b", "small")):
        decision = decide(core, mounting("map", nodeSelector={"zone": zone}))
        assert decision.volumes is not None
        assert decision.volumes.bindings == ((("default", "map"), given),)
        assert decision.volumes.timeout_s == 600.0


@pytest.mark.parametrize(
    "fields",
    [
        {"phase": "Released"},
        {"deleting": True},
        {"modes": ("ReadOnlyMany",)},
        {"block": True},
        {"attributes": "gold"},
        {"storage_class": "other"},
        {"labels": {"kind": "hdd"}},
        {"claim": {"namespace": "default", "name": "another"}},
        {"claim": {"namespace": "default", "name": "map", "uid": "an older one"}},
        {"size": "1023Mi"},
    ],
)
def test_a_volume_that_does_not_suit_the_claim_is_not_given(fields: Json) -> None:
    no_provisioner = make_class(provisioner="kubernetes.io/no-provisioner")
    claim = make_claim("map", selector={"matchLabels": {"kind": "ssd"}})
    fitting = {"labels": {"kind": "ssd"}}
    assert decide(world(no_provisioner, claim, make_volume("v", **fitting)), mounting("map")).placed
    assert not decide(world(no_provisioner, claim, make_volume("v", **fitting | fields)), mounting("map")).placed


def test_a_volume_set_aside_for_the_claim_is_taken_before_smaller_ones_and_rules_them_out() -> None:
    core = world(
        make_class(provisioner="kubernetes.io/no-provisioner"),
        make_volume("small", size="1Gi"),
        make_volume("mine", size="50Gi", on=["n2"], phase="Bound", claim={"namespace": "default", "name": "map"}),
        make_claim("map", size="1Gi"),
    )
    assert refusals(core, mounting("map")) == [(NONE_FREE,), (NONE_FREE,), ()]
    plan = decide(core, mounting("map")).volumes
    assert plan is not None
    assert plan.bindings == ((("default", "map"), "mine"),)


def test_two_claims_of_a_pod_never_get_the_same_volume_and_the_smaller_one_chooses_first() -> None:
    core = world(
        make_class(provisioner="kubernetes.io/no-provisioner"),
        make_volume("five", size="5Gi"),
        make_volume("nine", size="9Gi"),
        make_claim("large", size="4Gi"),
        make_claim("small", size="1Gi"),
    )
    plan = decide(core, mounting("large", "small")).volumes
    assert plan is not None
    assert dict(plan.bindings) == {("default", "small"): "five", ("default", "large"): "nine"}
    core.cluster.volumes.remove_volume(make_volume("nine"))
    assert not decide(core, mounting("large", "small")).placed


def test_an_assumed_pod_takes_its_volume_from_others_until_it_is_forgotten() -> None:
    core = world(
        make_class(provisioner="kubernetes.io/no-provisioner"), make_volume("v"), make_claim("a"), make_claim("b")
    )
    assert core.schedule_one(mounting("a", name="one")).placed
    refused = core.schedule_one(mounting("b", name="two"))
    assert not refused.placed
    assert NONE_FREE in refused.message
    core.cluster.forget("uid-one")
    assert core.schedule_one(mounting("b", name="two")).placed


def test_a_class_that_can_make_volumes_allows_its_topologies_only() -> None:
    zones = [{"matchLabelExpressions": [{"key": "zone", "values": ["a", "c"]}]}]
    core = world(make_class(topologies=zones), make_claim("map"))
    assert refusals(core, mounting("map")) == [(), (NONE_FREE,), ()]
    decision = decide(core, mounting("map"))
    assert decision.volumes is not None
    assert decision.volumes.provisions == (("default", "map"),)
    assert decision.volumes.bindings == ()
    assert scores(core, mounting("map")) == [0, 0]


def test_a_claim_that_was_tied_to_a_node_can_only_go_there() -> None:
    core = world(make_class(), make_claim("map", selected="n1"))
    assert refusals(core, mounting("map")) == [(NONE_FREE,), (), (NONE_FREE,)]


def test_two_pods_with_one_claim_to_be_made_go_to_the_same_node() -> None:
    core = world(make_class(), make_claim("map"))
    first = core.schedule_one(mounting("map", name="one"))
    second = core.schedule_one(mounting("map", name="two"))
    assert first.node == second.node
    core.cluster.forget("uid-two")
    assert sum(not texts for texts in refusals(core, mounting("map", name="three"))) == 1
    core.cluster.forget("uid-one")
    assert sum(not texts for texts in refusals(core, mounting("map", name="three"))) == 3


def test_reported_room_counts_when_the_driver_wants_it() -> None:
    room = [
        make_capacity("a", "10Gi", labels={"zone": "a"}),
        make_capacity("b", "100Gi", most="4Gi", labels={"zone": "b"}),
        make_capacity("lost", "100Gi", labels=None),
    ]
    driver = make_driver("make.example", capacity=True)
    core = world(make_class(), make_claim("map", size="5Gi"), driver, *room)
    assert refusals(core, mounting("map")) == [(), (NO_SPACE,), (NO_SPACE,)]
    core.cluster.volumes.apply_driver(make_driver("make.example"))
    assert refusals(core, mounting("map")) == [(), (), ()]
    assert scores(core, mounting("map")) == [0, 0, 0]


def test_room_that_stays_free_scores_and_claims_of_a_class_share_it() -> None:
    room = [make_capacity("a", "10Gi", labels={"zone": "a"}), make_capacity("b", "40Gi", labels={"zone": "b"})]
    driver = make_driver("make.example", capacity=True)
    core = world(make_class(), make_claim("map", size="4Gi"), make_claim("log", size="4Gi"), driver, *room)
    assert scores(core, mounting("map")) == [60, 90]
    assert scores(core, mounting("map", "log")) == [20, 80]


def test_the_shape_decides_what_a_full_volume_is_worth_and_1_35_does_not_score_volumes() -> None:
    objects = (
        make_class(provisioner="kubernetes.io/no-provisioner"),
        make_volume("v", size="10Gi", on=["n0"]),
        make_volume("w", size="5Gi", on=["n1"]),
        make_claim("map", size="5Gi"),
    )
    packing = [{"utilization": 0, "score": 0}, {"utilization": 100, "score": 10}]
    assert scores(world(*objects, args={"VolumeBinding": {"shape": packing}}), mounting("map")) == [50, 100]
    assert scores(world(*objects, args={"VolumeBinding": {"compatVersion": "1.35"}}), mounting("map")) == []
