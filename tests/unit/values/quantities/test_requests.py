from typing import Any

import msgspec
import pytest

from robotapp_api.values.quantities.requests import DEFAULT_CPU_MILLI, DEFAULT_MEMORY_BYTES, pod_requests
from robotapp_scheduler.core.api.core_v1 import Pod, PodSpec
from robotapp_scheduler.core.pods.in_place_resize import held_per_container
from robotapp_scheduler.core.pods.pod_signature import requests_of

Json = dict[str, Any]
MIB = 1024 * 1024


def container(*, sidecar: bool = False, **requests: str) -> Json:
    found: Json = {"resources": {"requests": requests}}
    return {**found, "restartPolicy": "Always"} if sidecar else found


def spec(*containers: Json, **fields: Any) -> PodSpec:
    return msgspec.convert({"containers": list(containers), **fields}, PodSpec)


def test_containers_add_up() -> None:
    found = pod_requests(spec(container(cpu="100m", memory="1Mi"), container(cpu="0.2")))
    assert found.exact == {"cpu": 300, "memory": MIB}


def test_an_init_step_counts_only_where_it_needs_more_than_the_containers() -> None:
    found = pod_requests(spec(container(cpu="100m", memory="4Mi"), initContainers=[container(cpu="1", memory="1Mi")]))
    assert found.exact == {"cpu": 1000, "memory": 4 * MIB}


def test_sidecars_run_beside_the_containers_and_beside_the_init_steps_after_them() -> None:
    init = [container(cpu="3"), container(sidecar=True, cpu="1"), container(cpu="2500m")]
    assert pod_requests(spec(container(cpu="2"), initContainers=init)).exact == {"cpu": 3500}


def test_overhead_comes_on_top_of_everything() -> None:
    found = pod_requests(spec(container(cpu="100m"), overhead={"cpu": "10m", "memory": "1Mi"}))
    assert found.exact == {"cpu": 110, "memory": MIB}
    assert found.scored == {"cpu": 110, "memory": DEFAULT_MEMORY_BYTES + MIB}


def test_pod_level_requests_replace_the_sums_of_cpu_memory_and_hugepages_only() -> None:
    resources = {"requests": {"cpu": "2", "hugepages-2Mi": "4Mi", "nvidia.com/gpu": "9"}}
    found = pod_requests(spec(container(cpu="100m", memory="1Mi"), resources=resources))
    assert found.exact == {"cpu": 2000, "memory": MIB, "hugepages-2Mi": 4 * MIB}


def test_the_scorer_of_an_incoming_pod_does_not_know_pod_level_requests() -> None:
    found = pod_requests(spec(container(cpu="100m"), resources={"requests": {"cpu": "2"}}))
    assert found.scored["cpu"] == 100
    assert found.placed["cpu"] == 2000


def test_every_container_without_a_request_counts_with_a_default_and_an_explicit_zero_stays_zero() -> None:
    found = pod_requests(spec(container(), container(cpu="0", memory="0")))
    assert found.exact.get("cpu", 0) == 0
    assert found.scored == {"cpu": DEFAULT_CPU_MILLI, "memory": DEFAULT_MEMORY_BYTES}


def test_amounts_are_rounded_up() -> None:
    found = pod_requests(spec(container(cpu="1u", memory="1.2")))
    assert found.exact == {"cpu": 1, "memory": 2}


def test_an_unreadable_amount_is_named() -> None:
    with pytest.raises(ValueError, match="lots"):
        pod_requests(spec(container(cpu="lots")))


# --- Resize in place ---------------------------------------------------------------------------------------------------


def running(asked: Json, *, granted: Json | None = None, in_force: Json | None = None, level: Json | None = None,
            pending: str = "", **status: Any) -> Pod:  # fmt: skip
    """A pod of one container; `granted` and `in_force` are what its kubelet says about it."""
    told: Json = {"name": "c", "allocatedResources": granted}
    if in_force is not None:
        told["resources"] = {"requests": in_force}
    body: Json = {"containers": [{"name": "c", "resources": {"requests": asked}}]}
    if level is not None:
        body["resources"] = {"requests": level}
    conditions = [{"type": "PodResizePending", "status": "True", "reason": pending}] if pending else []
    return msgspec.convert(
        {"spec": body, "status": {"containerStatuses": [told], "conditions": conditions, **status}}, Pod
    )


def test_a_pod_that_grows_holds_what_it_asks_for_and_one_that_shrinks_what_is_still_in_force() -> None:
    assert requests_of(running({"cpu": "2"}, granted={"cpu": "1"}, in_force={"cpu": "1"})).exact == {"cpu": 2000}
    assert requests_of(running({"cpu": "1"}, granted={"cpu": "1"}, in_force={"cpu": "2"})).exact == {"cpu": 2000}
    assert requests_of(running({"cpu": "1"}, granted={"cpu": "3"})).exact == {"cpu": 3000}


def test_a_resize_that_the_kubelet_calls_infeasible_does_not_count_a_deferred_one_does() -> None:
    held = {"granted": {"cpu": "1"}, "in_force": {"cpu": "1"}}
    assert requests_of(running({"cpu": "64"}, pending="Infeasible", **held)).exact == {"cpu": 1000}
    assert requests_of(running({"cpu": "64"}, pending="Deferred", **held)).exact == {"cpu": 64000}


def test_the_three_sides_of_a_pod_are_summed_before_they_are_compared() -> None:
    raw = {
        "spec": {
            "containers": [
                {"name": "a", "resources": {"requests": {"cpu": "3"}}},
                {"name": "b", "resources": {"requests": {"cpu": "1"}}},
            ]
        },
        "status": {
            "containerStatuses": [
                {"name": "a", "allocatedResources": {"cpu": "1"}},
                {"name": "b", "allocatedResources": {"cpu": "2"}},
            ]
        },
    }
    assert requests_of(msgspec.convert(raw, Pod)).exact == {"cpu": 4000}


def test_a_resized_sidecar_counts_and_a_resized_init_step_only_where_it_needs_more() -> None:
    raw = {
        "spec": {
            "containers": [{"name": "main", "resources": {"requests": {"cpu": "1"}}}],
            "initContainers": [
                {"name": "step", "resources": {"requests": {"cpu": "1"}}},
                {"name": "side", "restartPolicy": "Always", "resources": {"requests": {"cpu": "1"}}},
            ],
        },
        "status": {
            "initContainerStatuses": [
                {"name": "step", "allocatedResources": {"cpu": "9"}},
                {"name": "side", "allocatedResources": {"cpu": "3"}},
            ]
        },
    }
    assert requests_of(msgspec.convert(raw, Pod)).exact == {"cpu": 9000}


def test_pod_level_status_replaces_the_containers_and_counts_beside_pod_level_requests() -> None:
    status = {"allocatedResources": {"cpu": "3", "memory": "1Mi"}, "resources": {"requests": {"cpu": "2"}}}
    pod = running({"cpu": "100m"}, granted={"cpu": "9"}, level={"cpu": "1"}, **status)
    assert requests_of(pod).exact == {"cpu": 3000, "memory": MIB}
    assert requests_of(running({"cpu": "100m"}, granted={"cpu": "9"}, **status)).exact == {"cpu": 3000, "memory": MIB}
    infeasible = running({"cpu": "100m"}, level={"cpu": "8"}, pending="Infeasible", **status)
    assert requests_of(infeasible).exact["cpu"] == 3000


def test_a_container_whose_status_says_what_its_spec_says_costs_no_memory() -> None:
    same = running({"cpu": "1"}, granted={"cpu": "1"}, in_force={"cpu": "1"})
    assert same.status.container_statuses == ()
    assert not same.status.resizes
    assert running({"cpu": "1"}, granted={"cpu": "2"}).status.resizes


def test_a_placed_pod_with_pod_level_requests_has_defaults_for_what_is_not_named_there() -> None:
    found = pod_requests(spec(container(), container(), resources={"requests": {"memory": "1Mi"}}))
    assert found.placed == {"cpu": 2 * DEFAULT_CPU_MILLI, "memory": MIB}


def test_what_only_the_overhead_of_such_a_pod_names_gets_no_default() -> None:
    level = {"requests": {"cpu": "1"}}
    found = pod_requests(spec(container(), resources=level, overhead={"cpu": "250m", "memory": "120Mi"}))
    assert found.placed == {"cpu": 1250, "memory": 120 * MIB}
    assert found.scored == {"cpu": 250 + DEFAULT_CPU_MILLI, "memory": 120 * MIB + DEFAULT_MEMORY_BYTES}


def test_a_running_pod_without_requests_counts_with_defaults_while_it_is_resized() -> None:
    found = requests_of(running({}, granted={"cpu": "1"}))
    assert found.exact == {"cpu": 1000}
    assert found.placed == {"cpu": 1000, "memory": DEFAULT_MEMORY_BYTES}


def two(*, infeasible: bool = False, in_force: bool = True) -> Pod:
    """a shrinks from 3 to 1 CPU while b grows from 1 to 2; c is left alone."""
    sides = {"a": ("1", "3"), "b": ("2", "1"), "c": ("1", "1")}
    containers = [{"name": name, "resources": {"requests": {"cpu": asked}}} for name, (asked, _) in sides.items()]
    statuses: list[Json] = [{"name": name, "allocatedResources": {"cpu": held}} for name, (_, held) in sides.items()]
    if in_force:
        statuses = [{**each, "resources": {"requests": each["allocatedResources"]}} for each in statuses]
    conditions = [{"type": "PodResizePending", "status": "True", "reason": "Infeasible"}] if infeasible else []
    status = {"containerStatuses": statuses, "conditions": conditions}
    return msgspec.convert({"spec": {"containers": containers}, "status": status}, Pod)


def test_until_1_35_each_container_held_the_most_of_its_sides() -> None:
    assert requests_of(two()).exact == {"cpu": 5000}
    assert requests_of(held_per_container(two())).exact == {"cpu": 6000}
    assert requests_of(held_per_container(two(infeasible=True))).exact == {"cpu": 5000}
    assert requests_of(held_per_container(two(in_force=False))).exact == {"cpu": 4000}, (
        "not said by the kubelet: the spec"
    )


def test_a_pod_that_is_not_being_resized_is_itself_in_every_release() -> None:
    same = running({"cpu": "1"}, granted={"cpu": "1"}, in_force={"cpu": "1"})
    assert held_per_container(same) is same


def test_other_amounts_of_a_resized_container_are_kept_by_name() -> None:
    pod = running({"cpu": "1", "memory": "1Mi"}, granted={"cpu": "500m"}, in_force={"cpu": "1500m", "memory": "1Ki"})
    assert requests_of(held_per_container(pod)).exact == {"cpu": 1500, "memory": MIB}
