from typing import Any

import msgspec
import pytest

from robotapp_api.values.requests import DEFAULT_CPU_MILLI, DEFAULT_MEMORY_BYTES, pod_requests
from robotapp_scheduler.core.objects import PodSpec

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
