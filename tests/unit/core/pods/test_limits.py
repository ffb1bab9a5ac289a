"""Pods that ask for too much are refused before anything is looked up; every other pod is none of this rule's business."""

import pytest
from hypothesis import given
from tests.support.scheduler.poison import poison_pods
from tests.support.scheduling import make_core, make_node, make_pod, to_pod

from campaigns.cluster_cases import FAMILIES, Case, cases
from robotapp_scheduler.core.cycle.diagnosis import EXCESSIVE_POD
from robotapp_scheduler.core.framework.interface import Code
from robotapp_scheduler.core.pods.limits import exceeded_limit

EXCESSIVE = {
    "spread-keys-hard": "5000 topologySpreadConstraints, more than 64",
    "podAffinity-required": "10000 pod affinity terms, more than 128",
    "podAntiAffinity-preferred": "10000 pod affinity terms, more than 128",
    "spread-selector": "5000 label selector requirements, more than 1024",
    "spread-label-keys": "5001 label selector requirements, more than 1024",
    "podAffinity-namespace-selector": "5001 label selector requirements, more than 1024",
    "node-terms": "10000 node affinity terms, more than 512",
    "node-preferred": "10000 node affinity terms, more than 512",
    "node-expressions": "10000 node affinity expressions, more than 2048",
    "node-selector": "10000 nodeSelector labels, more than 512",
    "tolerations": "10000 tolerations, more than 512",
    "resources": "10000 resources, more than 128",
    "host-ports": "10000 host ports, more than 1024",
    "claims": "5000 volumes, more than 1024",
}
POISON = {each.name: each for each in poison_pods()}


@pytest.mark.parametrize("name", EXCESSIVE)
def test_too_much_of_anything_is_named_with_its_number_and_the_limit(name: str) -> None:
    told = exceeded_limit(to_pod(POISON[name].body).spec)
    assert told == f"pod asks for {EXCESSIVE[name]} are not looked up"


def test_an_excessive_pod_is_told_so_and_only_its_own_change_brings_it_back() -> None:
    core = make_core(make_node("n"))
    core.queue.add(to_pod(POISON["node-selector"].body))
    (queued,) = core.queue.pop()
    (decision,) = core.schedule([queued])
    assert decision.code is Code.UNRESOLVABLE
    assert decision.rejected_by == {EXCESSIVE_POD}
    assert decision.message == (
        "0/1 nodes are available: pod asks for 10000 nodeSelector labels, more than 512 are not looked up."
    )


def test_ordinary_pods_ask_for_nothing_excessive() -> None:
    assert exceeded_limit(make_pod("p").spec) == ""


@given(cases(list(FAMILIES)))
def test_no_pod_of_the_comparisons_is_excessive(case: Case) -> None:
    assert exceeded_limit(to_pod(case.pod).spec) == ""


def test_every_poison_has_a_name_of_its_own() -> None:
    found = poison_pods()
    assert len({each.name for each in found}) == len(found) > 80
