"""Amounts by hand: rounding, init steps and sidecars, pod level, overhead, resize, the scorer's defaults."""

from typing import Any

import pytest

from campaigns.cluster_cases.scene import make_pod
from campaigns.reference_scheduler.nodes.resources import DEFAULTS, held, scored_incoming, scored_placed
from campaigns.reference_scheduler.quantities import amount

Json = dict[str, Any]
MIB = 1024 * 1024


def container(cpu: str | None, name: str = "c", **fields: Any) -> Json:
    return {"name": name, "resources": {"requests": {} if cpu is None else {"cpu": cpu}}, **fields}


def pod_of(*containers: Json, steps: tuple[Json, ...] = (), **spec: Any) -> Json:
    pod = make_pod("p")
    pod["spec"] |= {"containers": list(containers), "initContainers": list(steps), **spec}
    return pod


@pytest.mark.parametrize(
    ("resource", "text", "expected"),
    [
        ("cpu", "0.5", 500),
        ("cpu", "0.0001", 1),
        ("cpu", "1500m", 1500),
        ("cpu", "1e3", 1_000_000),
        ("cpu", "100n", 1),
        ("memory", "900m", 1),
        ("memory", "7.5Gi", 8_053_063_680),
        ("memory", "1500M", 1_500_000_000),
        ("memory", "1E", 10**18),
        ("memory", "1e9", 10**9),
        ("memory", "8Ei", 2**63 - 1),
    ],
)
def test_amounts_are_rounded_up_to_milli_or_whole_units(resource: str, text: str, expected: int) -> None:
    assert amount(resource, text) == expected


def test_a_plain_init_step_runs_beside_the_sidecars_started_before_it() -> None:
    steps = (container("500m"), container("50m", restartPolicy="Always"), container("480m"))
    # 300 + 50 running, 500 first, 50 + 480 third.
    assert held(pod_of(container("100m"), container("200m"), steps=steps), "cpu") == 530


def test_sidecars_run_beside_the_containers() -> None:
    steps = (container("300m", restartPolicy="Always"), container("350m"))
    assert held(pod_of(container("400m"), steps=steps), "cpu") == 700


def test_pod_level_requests_replace_the_sum_and_overhead_comes_on_top() -> None:
    level = {"requests": {"cpu": "2", "example.com/gpu": "9"}}
    pod = pod_of(container("100m"), resources=level, overhead={"cpu": "250m"})
    assert held(pod, "cpu") == 2250
    assert held(pod, "example.com/gpu") == 0


def test_the_scorer_sees_container_sums_of_the_incoming_pod_and_the_pod_level_of_placed_ones() -> None:
    pod = pod_of(container("100m"), resources={"requests": {"cpu": "2"}})
    assert scored_incoming(pod, "cpu") == 100
    assert scored_placed(pod, "cpu") == 2000


def test_a_missing_request_counts_as_the_default_and_an_explicit_zero_stays() -> None:
    pod = pod_of(container(None), container("0"), container("1"))
    assert scored_incoming(pod, "cpu") == 1100
    assert scored_placed(pod, "cpu") == 1100
    assert scored_incoming(pod, "memory") == 3 * 200 * MIB
    assert held(pod, "cpu") == 1000


def test_init_steps_without_a_request_get_the_default_as_well() -> None:
    assert scored_incoming(pod_of(container("50m"), steps=(container(None),)), "cpu") == DEFAULTS["cpu"]


def test_a_placed_pod_with_pod_level_requests_gets_a_default_only_for_what_neither_level_names() -> None:
    level = {"requests": {"memory": "1Gi"}}
    assert scored_placed(pod_of(container(None), container("300m"), resources=level), "cpu") == 300
    assert scored_placed(pod_of(container(None), container(None), resources=level), "cpu") == 200


def resized(*statuses: Json, spec: tuple[str, ...], conditions: tuple[Json, ...] = ()) -> Json:
    pod = pod_of(*(container(cpu, name=f"c{at}") for at, cpu in enumerate(spec)))
    named = [{"name": f"c{at}", **status} for at, status in enumerate(statuses)]
    pod["status"] |= {"containerStatuses": named, "conditions": list(conditions)}
    return pod


def status(allocated: str | None, actual: str | None) -> Json:
    found: Json = {} if allocated is None else {"allocatedResources": {"cpu": allocated}}
    return found if actual is None else found | {"resources": {"requests": {"cpu": actual}}}


def test_a_resize_in_progress_holds_the_largest_of_the_three_totals() -> None:
    assert held(resized(status("500m", "300m"), spec=("100m",)), "cpu") == 500
    assert held(resized(status(None, "700m"), spec=("100m",)), "cpu") == 700
    assert held(resized(status("50m", None), spec=("100m",)), "cpu") == 100


def test_totals_are_compared_since_1_36_and_containers_before() -> None:
    pod = resized(status("100m", "300m"), status("300m", "100m"), spec=("100m", "300m"))
    assert held(pod, "cpu") == 400
    assert held(pod, "cpu", compat_version="1.35") == 600


def test_an_infeasible_resize_leaves_the_wish_out() -> None:
    pending = {"type": "PodResizePending", "status": "True", "reason": "Infeasible"}
    pod = resized(status("500m", "300m"), spec=("9",), conditions=(pending,))
    assert held(pod, "cpu") == 500
    assert held(pod, "cpu", compat_version="1.35") == 500
    pending["reason"] = "Deferred"
    assert held(pod, "cpu") == 9000


def test_an_infeasible_resize_of_a_container_nothing_else_is_known_of_holds_nothing() -> None:
    pending = {"type": "PodResizePending", "status": "True", "reason": "Infeasible"}
    pod = resized({}, spec=("9",), conditions=(pending,))
    assert held(pod, "cpu") == 0
    assert scored_placed(pod, "cpu") == 100
