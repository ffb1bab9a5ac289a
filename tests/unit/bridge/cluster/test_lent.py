"""What a past spec adds to the present one: everything that runs, and that is run with."""

from typing import Any

import pytest
from tests.live.attacks.table.attack import Attack
from tests.live.attacks.table.escalations import REFERENCES, SERVICES
from tests.live.attacks.table.lending import FREE_FIELDS

from rigel_bridge.cluster import lent
from rigel_bridge.cluster.lent import find_additions

Json = dict[str, Any]
_IDENTITIES = [attack for attack in (*REFERENCES, *SERVICES) if attack.good != attack.changed(attack.good)]


@pytest.mark.parametrize("attack", _IDENTITIES, ids=lambda attack: attack.key)
def test_what_the_policy_would_refuse_a_writer_is_told_before_it_is_brought_back(attack: Attack) -> None:
    """Attacks on an app that has an account or a Secret already change its image or its command; the difference shows both."""
    honest, planted = attack.good["spec"], attack.changed(attack.good)["spec"]
    lends = any(
        line in ("command", "lifecycle") for line in planted["components"][0].keys() - honest["components"][0].keys()
    )
    assert lends or find_additions(honest, planted)
    assert find_additions(planted, planted) == []


def test_images_of_all_containers_and_of_infrastructure_are_told_once_each() -> None:
    first = {"name": "first", "image": "i:1"}
    new = {
        "ros1": {"image": "m:1"},
        "ros2": {"discovery": {"image": "d:1"}},
        "components": [{"name": "a", "image": "a:1", "template": {"spec": {"initContainers": [first, first]}}}],
    }
    new["overrides"] = [{"name": "o", "components": [{"name": "a", "image": "o:1"}]}]
    assert find_additions({}, new) == [
        "spec.ros1: image m:1",
        "spec.ros2.discovery: image d:1",
        "component a: image a:1",
        "component a: image i:1",
        "override o of component a: image o:1",
    ]


def test_what_goes_or_stays_is_no_addition() -> None:
    old = {"components": [{"name": "a", "image": "a:1", "envFrom": [{"secretRef": {"name": "s"}}]}]}
    assert find_additions(old, {"components": [{"name": "a", "image": "a:1", "args": ["x"]}]}) == []


@pytest.mark.parametrize(
    "spec", [{"components": 1}, {"components": [None]}, {"components": [{"env": [1], "template": []}]}, {"ros1": 1}]
)
def test_a_spec_that_no_api_server_has_seen_is_read_all_the_same(spec: Json) -> None:
    assert find_additions({}, spec) == []


def test_what_is_free_is_what_the_charts_policy_leaves_free() -> None:
    assert set(FREE_FIELDS["valueFrom"]) == lent._FREE_VALUES
    assert set(FREE_FIELDS["sources"]) == lent._FREE_SOURCES
    assert set(FREE_FIELDS["volumes"]) == lent._FREE_VOLUMES
