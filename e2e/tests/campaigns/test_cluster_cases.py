"""Cases are reproducible, cover what their names say, and hold only what an API server would take.

A third of the families each day; ROBOTAPP_SAMPLES=all takes all of them.
"""

from collections import Counter

import pytest
from tests.support.seeds import third_of_today

from campaigns.cluster_cases import FAMILIES, Case, build_case, seeded_case
from campaigns.cluster_cases.case import admitted
from campaigns.cluster_cases.choices import Choices, SeededChoices
from campaigns.reference_scheduler import Decision, decide

EVERY = list(FAMILIES)
PER_FAMILY = 60
SCORED = ("default-spread", "images", "inline-disks", "preferred-affinity", "preferred-pod-affinity", "soft-spread")
"""Families that keep nobody out, or seldom."""


def of(family: str, count: int = PER_FAMILY) -> list[Case]:
    return [seeded_case("t", number=number, families=[family]) for number in range(count)]


def outcome(decision: Decision) -> str:
    if decision.refused is not None or decision.error:
        return "refused"
    if decision.preemption is not None and decision.preemption.victims:
        return "victims"
    return "placed" if decision.feasible else "nowhere"


def test_a_case_is_a_function_of_seed_and_number() -> None:
    first, again = (seeded_case("s", number=7, families=EVERY) for _ in range(2))
    assert first == again
    assert first.objects != seeded_case("s", number=7 + len(EVERY), families=EVERY).objects


class LeastChoices(Choices):
    """Takes the first option of all."""

    def integer(self, low: int, high: int) -> int:
        del high
        return low


def test_the_first_options_give_the_plainest_case() -> None:
    case = build_case(LeastChoices(), EVERY, first="taints")
    assert case.families == ("taints",)
    assert len(case.cluster.nodes) == 3
    assert case.cluster.pods == []


def test_the_families_take_turns_at_the_centre() -> None:
    centres = [seeded_case("s", number=number, families=EVERY).families[0] for number in range(len(EVERY))]
    assert centres == EVERY


@pytest.mark.parametrize("family", EVERY)
def test_names_and_uids_are_unique_in_every_case(family: str) -> None:
    for case in of(family, 20):
        keys = [(each["kind"], each["metadata"].get("namespace"), each["metadata"]["name"]) for each in case.objects]
        uids = [each["metadata"]["uid"] for each in case.objects]
        assert len(set(keys)) == len(keys)
        assert len(set(uids)) == len(uids)


@pytest.mark.parametrize("family", third_of_today(name for name, each in FAMILIES.items() if not each.alone))
def test_a_family_lets_pods_in_and_keeps_pods_out(family: str) -> None:
    found = Counter(outcome(decide(case.cluster, case.pod)) for case in of(family))
    assert found["placed"] >= 3
    assert found["nowhere"] + found["victims"] >= 1 or family in SCORED


@pytest.mark.parametrize(
    "family",
    third_of_today(["preemption", "disruption-budgets", "nominations", "crowded-nominations", "crowded-volumes"]),
)
def test_preemption_finds_victims_and_sometimes_none(family: str) -> None:
    found = Counter(outcome(decide(case.cluster, case.pod)) for case in of(family, 200))
    assert found["victims"] >= 20
    assert found["nowhere"] >= 20


@pytest.mark.parametrize("family", third_of_today(EVERY))
def test_resources_are_what_an_api_server_takes(family: str) -> None:
    """Extended resources come with equal limits, ports and constraints once, pod-level requests cover the containers."""
    for case in of(family, 30):
        for pod in (each for each in case.objects if each["kind"] == "Pod"):
            spec = pod["spec"]
            names = [each["name"] for each in [*spec["containers"], *spec.get("initContainers", [])]]
            assert len(set(names)) == len(names)
            for container in spec["containers"]:
                resources = container.get("resources", {})
                for name, amount in resources.get("limits", {}).items():
                    assert resources["requests"][name] == amount
            keys = [
                (each["topologyKey"], each["whenUnsatisfiable"]) for each in spec.get("topologySpreadConstraints", [])
            ]
            assert len(set(keys)) == len(keys)


def test_label_keys_become_requirements_and_the_given_pod_stays_as_it_is() -> None:
    term = {"labelSelector": {}, "topologyKey": "z", "matchLabelKeys": ["rev", "gone"], "mismatchLabelKeys": ["app"]}
    affinity = {"podAffinity": {"requiredDuringSchedulingIgnoredDuringExecution": [term]}}
    pod = {"metadata": {"labels": {"rev": "1", "app": "a"}}, "spec": {"affinity": affinity, "containers": []}}
    made = admitted(pod)["spec"]["affinity"]["podAffinity"]["requiredDuringSchedulingIgnoredDuringExecution"][0]
    assert made["labelSelector"] == {
        "matchExpressions": [
            {"key": "rev", "operator": "In", "values": ["1"]},
            {"key": "app", "operator": "NotIn", "values": ["a"]},
        ]
    }
    assert term["labelSelector"] == {}


def test_some_takes_different_options_in_their_order() -> None:
    for seed in range(50):
        chosen = SeededChoices(str(seed)).some("abcd", least=1, most=3)
        assert 1 <= len(chosen) <= 3
        assert chosen == sorted(set(chosen))
