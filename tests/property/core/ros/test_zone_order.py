"""The order of preferred zones under the shipped weights: no difference in load outweighs it."""

from typing import Final

import msgspec
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.support.scheduling import make_core, make_info, make_node, make_pod
from tests.support.seeds import count_examples

from robotapp_api.model.names import Annotation, Label
from robotapp_scheduler.core.api.core_v1 import Selecting
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore

CHECKS = settings(deadline=None, max_examples=count_examples(80), suppress_health_check=[HealthCheck.too_slow])
CPU_MILLI, MEMORY_MIB = 16_000, 32_768
POD_CPU_MILLI, POD_MEMORY_MIB = 500, 1_024
PODS: Final = 6
ELSEWHERE: Final = "elsewhere"
SHARES = st.sampled_from((0, 5, 50, 80, 90, 95, 100))
MORE = st.lists(st.tuples(st.integers(0, 4), SHARES, SHARES), max_size=4)
"""Per node the place of its zone in the order (the last is no preferred one), and how much of its cpu and memory is taken."""


@st.composite
def clusters(draw: st.DrawFn, zones: int) -> list[tuple[int, int, int]]:
    """One node at least of each zone, so that the steps between the zones are as small as they get."""
    return [*((zone, draw(SHARES), draw(SHARES)) for zone in range(zones + 1)), *draw(MORE)]


def zone_names(zones: int) -> list[str]:
    return [f"zone-{index}" for index in range(zones)]


def core_of(nodes: list[tuple[int, int, int]], zones: int) -> SchedulerCore:
    names = zone_names(zones)
    core = make_core(
        *(
            make_node(
                f"n{index}", cpu=f"{CPU_MILLI}m", memory=f"{MEMORY_MIB}Mi",
                labels={str(Label.ZONE): names[zone] if zone < zones else ELSEWHERE},
            )
            for index, (zone, _, _) in enumerate(nodes)
        )
    )  # fmt: skip
    for index, (_, cpu, memory) in enumerate(nodes):
        used = {"cpu": f"{CPU_MILLI * cpu // 100}m", "memory": f"{MEMORY_MIB * memory // 100}Mi"}
        core.cluster.apply_pod(make_pod(f"load-{index}", node=f"n{index}", **used))
    return core


def fill(nodes: list[tuple[int, int, int]], zones: int, qos_class: str, *, served: bool) -> None:
    """Pods one after the other until no node takes one: each goes to the earliest zone that has room for it."""
    core = core_of(nodes, zones)
    wanted = ", ".join(f'"{name}"' for name in zone_names(zones))
    annotations = {
        str(Annotation.TOPOLOGY): f'{{"preferred_zones": [{wanted}]}}',
        str(Annotation.POLICIES): f'{{"qos_class": "{qos_class}"}}',
    }
    if served:
        raw = {"metadata": {"namespace": "default", "name": "planner"}, "spec": {"selector": {"app": "planner"}}}
        core.cluster.topology.apply_selecting("Service", msgspec.convert(raw, Selecting))
    for number in range(PODS):
        room = [min(zone, zones) for index, (zone, _, _) in enumerate(nodes) if has_room(core, index)]
        pod = make_info(
            f"planner-{number}",
            cpu=f"{POD_CPU_MILLI}m",
            memory=f"{POD_MEMORY_MIB}Mi",
            labels={"app": "planner"},
            annotations=annotations,
        )
        node = core.schedule_one(pod).node
        if not room:
            assert not node
            return
        assert node
        zone = min(nodes[int(node.removeprefix("n"))][0], zones)
        assert zone == min(room), f"pod {number} went to zone {zone}, with room in {room}"


def has_room(core: SchedulerCore, index: int) -> bool:
    resources, row = core.cluster.nodes.resources, core.cluster.nodes.row_of[f"n{index}"]
    cpu_milli, memory_bytes = resources.allocatable[:2, row] - resources.requested[:2, row]
    return bool(cpu_milli >= POD_CPU_MILLI and memory_bytes >= POD_MEMORY_MIB << 20)


@CHECKS
@given(st.data(), st.integers(1, 4), st.sampled_from(["realtime", "best_effort", "system_default"]))
def test_load_never_outweighs_the_order_of_up_to_four_zones(data: st.DataObject, zones: int, qos_class: str) -> None:
    fill(data.draw(clusters(zones)), zones, qos_class, served=False)


@CHECKS
@given(st.data(), st.integers(1, 2))
def test_nor_does_the_spread_of_replicas_beside_it_that_of_two(data: st.DataObject, zones: int) -> None:
    fill(data.draw(clusters(zones)), zones, "realtime", served=True)
