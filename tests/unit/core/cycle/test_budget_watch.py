"""The annotation `robotics.io/better-node` over time: when it is written, kept, renewed and withdrawn, and how much work that is."""

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from itertools import pairwise
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.scheduler.late_apps import COMPONENTS, annotate, edge, measure, placed, planner, robot_and_servers
from tests.support.scheduling import Clock, app_object, chain, make_node, make_pod, member_pod, telemetry

from robotapp_api.model.names import Annotation
from robotapp_api.values.placement.better_node import BetterNode, parse_better_node
from robotapp_scheduler.core.api.core_v1 import Node
from robotapp_scheduler.core.cycle.better_node import (
    LOOKS,
    RENEW,
    REST_S,
    RETRY_S,
    ROUND_S,
    SEARCH_S,
    SEEN_S,
    SUCCESSOR_S,
    TICK_S,
    VALID,
    AnnotationWrite,
    BudgetWatch,
    WatchedPod,
    better_node,
)
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.robotics.edge_times import over_budget

WATCH = "robotapp_scheduler.core.cycle.better_node"
FOR_S = 15.0
START = datetime(2026, 1, 2, 3, 0, tzinfo=UTC)
Told = tuple[float, str]


class Cluster:
    """The app of `late_apps` under a watch; what it writes is seen at the next tick, agents report every two seconds."""

    def __init__(self, *, more: Sequence[Node] = (), **fields: Any) -> None:
        self.clock = Clock(0.0)
        self.core = robot_and_servers(*more, clock=self.clock, **fields)
        self.rtt_ms: dict[str, float] = {}
        self.writes: list[Told] = []
        self.watch = self.new_watch()
        self._seq = 0

    def new_watch(self) -> BudgetWatch:
        return BudgetWatch(self.core, clock=self.clock, now=lambda: START + timedelta(seconds=self.clock()))

    def run(self, seconds: float, *, step_s: float = 1.0) -> list[Told]:
        """(second, proposed node or "" for a withdrawal) of the writes meanwhile."""
        before = len(self.writes)
        for _ in range(round(seconds / step_s)):
            self.clock.forward(step_s)
            self._seq += 1
            measure(self.core, self.rtt_ms, seq=self._seq)
            for write in self.watch.tick():
                self.writes.append((self.clock(), write.better.node if write.better else ""))
                annotate(self.core, write.pod, write.better.text() if write.better else None)
        return self.writes[before:]

    @property
    def annotation(self) -> str | None:
        return (planner(self.core).pod.metadata.annotations or {}).get(Annotation.BETTER_NODE)


def late() -> Cluster:
    """With a proposal on the pod."""
    cluster = Cluster()
    assert [node for _, node in cluster.run(FOR_S + 2)] == ["e2"]
    return cluster


# --- When it is written -----------------------------------------------------------------------------------------------


def test_a_budget_that_was_exceeded_for_as_long_as_the_app_waits_gets_one_proposal_with_an_expiry() -> None:
    cluster = Cluster()
    assert cluster.run(FOR_S) == []
    assert cluster.run(2) == [(FOR_S + 1, "e2")]
    expires = (START + timedelta(seconds=FOR_S + 1) + VALID).isoformat().replace("+00:00", "Z")
    assert cluster.annotation == (
        f'{{"node": "e2", "edge": "/planner to driver", "before": "60ms", "after": "8ms", "expires": "{expires}"}}'
    )


def test_a_node_that_is_measured_only_after_the_first_search_is_proposed_within_seconds() -> None:
    cluster = Cluster()
    cluster.rtt_ms = dict.fromkeys(("e2", "e3"), 60.0)
    assert cluster.run(FOR_S + 2) == []
    began_s = cluster.clock()
    cluster.rtt_ms = {"e2": 8.0}
    ((at_s, node),) = cluster.run(SEARCH_S)
    assert node == "e2"
    assert at_s - began_s <= RETRY_S[-1] + 1


def test_a_node_with_one_slow_round_when_the_time_is_over_is_proposed_half_a_second_after_the_next_round() -> None:
    cluster = Cluster()
    cluster.run(FOR_S - 2)
    cluster.rtt_ms = dict.fromkeys(("e2", "e3"), 25.0)
    assert cluster.run(4, step_s=TICK_S) == []
    began_s = cluster.clock()
    cluster.rtt_ms = {"e2": 8.0}
    ((at_s, node),) = cluster.run(2, step_s=TICK_S)
    assert node == "e2"
    assert at_s - began_s <= RETRY_S[0] + TICK_S


def test_where_no_node_is_better_it_is_searched_for_less_often_as_time_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    cluster, searched_s = Cluster(), list[float]()
    cluster.rtt_ms = dict.fromkeys(("e2", "e3"), 60.0)
    monkeypatch.setattr(f"{WATCH}.better_node", lambda *_, **__: searched_s.append(cluster.clock()))
    cluster.run(FOR_S + 60, step_s=TICK_S)
    pauses_s = [after - before for before, after in pairwise(searched_s)]
    assert pauses_s == sorted(pauses_s)
    assert (pauses_s[0], pauses_s[-1]) == RETRY_S


def test_how_long_that_is_the_app_decides() -> None:
    cluster = Cluster(placement={"reschedule": {"for": "40s"}})
    assert cluster.run(45) == [(41.0, "e2")]


def test_a_link_that_is_cut_must_be_so_for_as_long() -> None:
    cluster = Cluster()
    found: list[Told] = []
    for seq in range(round(FOR_S) + 2):
        cluster.clock.forward(1)
        cluster.core.cluster.apply_telemetry(telemetry("amr", rtt_ms={"e2": 8.0}, lost=["e1"], seq=seq))
        found += [(cluster.clock(), write.better.text() if write.better else "") for write in cluster.watch.tick()]
    ((at_s, text),) = found
    assert at_s == FOR_S + 1
    assert '"node": "e2", "edge": "/planner to driver", "before": "999999s"' in text


def test_slow_rounds_that_do_not_last_write_nothing() -> None:
    cluster = Cluster()
    for _ in range(20):
        cluster.rtt_ms = {"e1": 60.0}
        cluster.run(FOR_S - 2)
        cluster.rtt_ms = {"e1": 10.0}
        cluster.run(1)
    assert cluster.writes == []


def two_edges(*, driver_ms: float, map_ms: float) -> Cluster:
    """The planner on e1 also has a budget of 30 ms with the map server on e3."""
    cluster = Cluster(
        edges=[edge("planner", "driver"), edge("planner", "map", "30ms")], components=(*COMPONENTS, {"name": "map"})
    )
    cluster.core.cluster.apply_pod(placed("map", "e3", cpu="100m", nodeSelector={"kubernetes.io/hostname": "e3"}))
    report(cluster, driver_ms=driver_ms, map_ms=map_ms)
    return cluster


def report(cluster: Cluster, *, driver_ms: float, map_ms: float) -> None:
    """The round trips of the planner's two connections from now on."""
    cluster.rtt_ms = {"e1": driver_ms}
    cluster.core.cluster.apply_telemetry(telemetry("e3", rtt_ms={"e1": map_ms, "e2": 9.0}, seq=round(cluster.clock())))


def test_each_connection_must_be_over_its_budget_for_as_long_on_its_own() -> None:
    cluster = two_edges(driver_ms=60.0, map_ms=10.0)
    assert cluster.run(FOR_S - 2) == []
    report(cluster, driver_ms=10.0, map_ms=90.0)
    assert cluster.run(FOR_S - 2) == [], "one of them has been late all the time, neither for long enough"
    assert [node for _, node in cluster.run(4)] == ["e2"]
    assert cluster.annotation is not None
    assert '"before": "90ms", "after": "9ms"' in cluster.annotation


def test_one_slow_report_of_another_connection_is_not_what_a_proposal_tells() -> None:
    cluster = two_edges(driver_ms=60.0, map_ms=10.0)
    assert cluster.run(FOR_S) == []
    report(cluster, driver_ms=60.0, map_ms=900.0)
    assert [node for _, node in cluster.run(2)] == ["e2"]
    assert cluster.annotation is not None
    assert '"before": "60ms", "after": "8ms"' in cluster.annotation


def test_when_its_connection_is_met_again_a_proposal_is_written_anew_for_the_one_that_is_late_now() -> None:
    cluster = two_edges(driver_ms=60.0, map_ms=10.0)
    assert [node for _, node in cluster.run(FOR_S + 2)] == ["e2"]
    report(cluster, driver_ms=10.0, map_ms=90.0)
    assert [node for _, node in cluster.run(REST_S + SEARCH_S + 2)] == ["e2"]
    assert cluster.annotation is not None
    assert '"edge": "/planner to map", "before": "90ms", "after": "9ms"' in cluster.annotation


def test_two_connections_that_are_late_do_not_take_turns() -> None:
    cluster = two_edges(driver_ms=60.0, map_ms=100.0)
    assert [node for _, node in cluster.run(FOR_S + 2)] == ["e2"]
    for driver_ms, map_ms in ((90.0, 50.0), (30.0, 100.0)) * 10:
        report(cluster, driver_ms=driver_ms, map_ms=map_ms)
        assert cluster.run(SEARCH_S) == []


def test_a_measurement_that_stays_away_ends_what_was_counted() -> None:
    cluster = Cluster()
    cluster.run(FOR_S - 1)
    cluster.core.cluster.remove_telemetry(telemetry("amr"))
    assert cluster.watch.tick() == []
    assert cluster.run(FOR_S - 1) == []


def test_nothing_is_written_for_a_cluster_in_which_nothing_is_measured() -> None:
    cluster = Cluster()
    cluster.core.cluster.remove_telemetry(telemetry("amr"))
    for _ in range(100):
        cluster.clock.forward(1)
        assert cluster.watch.tick() == []
    assert repr(cluster.watch) == "BudgetWatch(0 pods over budget or with a proposal)"


# --- While it holds ---------------------------------------------------------------------------------------------------


def test_while_nothing_changes_nothing_is_written_until_the_proposal_is_about_to_expire() -> None:
    cluster = late()
    before_s = (VALID - RENEW).total_seconds() - SEARCH_S
    assert cluster.run(before_s) == []
    assert [node for _, node in cluster.run(2 * SEARCH_S)] == ["e2"]


def test_a_node_as_good_as_the_proposed_one_does_not_take_its_place() -> None:
    cluster = late()
    cluster.rtt_ms = {"e3": 7.0}
    assert cluster.run(300) == []


def test_a_new_leader_goes_on_with_what_stands_on_the_pod() -> None:
    cluster = late()
    cluster.watch = cluster.new_watch()
    assert cluster.run(300) == []
    cluster.rtt_ms = {"e1": 5.0}
    cluster.watch = cluster.new_watch()
    assert [node for _, node in cluster.run(FOR_S + 2)] == [""]


# --- When it is withdrawn ---------------------------------------------------------------------------------------------


def test_a_proposal_is_withdrawn_when_the_budget_was_met_for_as_long_again() -> None:
    cluster = late()
    cluster.rtt_ms = {"e1": 5.0}
    assert cluster.run(FOR_S) == []
    assert [node for _, node in cluster.run(3)] == [""]
    assert cluster.annotation is None
    cluster.run(2 * REST_S)
    assert repr(cluster.watch) == "BudgetWatch(0 pods over budget or with a proposal)"


def test_a_proposal_of_a_node_that_has_no_room_any_more_is_replaced_or_withdrawn() -> None:
    cluster = late()
    cluster.run(REST_S)
    cluster.core.cluster.apply_pod(make_pod("load", node="e2", cpu="1500m"))
    assert [node for _, node in cluster.run(SEARCH_S + 1)] == ["e3"]
    cluster.core.cluster.apply_pod(make_pod("load-3", node="e3", cpu="1500m"))
    assert [node for _, node in cluster.run(SEARCH_S + 1)] == [""]


def test_an_annotation_that_cannot_be_read_is_replaced() -> None:
    cluster = Cluster()
    annotate(cluster.core, planner(cluster.core).pod, "soon")
    assert [node for _, node in cluster.run(FOR_S + 2)] == ["e2"]


def test_a_component_that_may_no_longer_move_loses_its_proposal() -> None:
    cluster = late()
    components = ({"name": "driver", "runsOn": ["Robot"]}, {"name": "planner", "runsOn": ["Robot"]})
    app = app_object(*components, edges=[edge("planner", "driver")], generation=2)
    cluster.core.cluster.apply_app(app)
    assert [node for _, node in cluster.run(SEARCH_S + 1)] == [""]
    assert cluster.run(100) == []


def test_a_component_that_was_scaled_up_loses_its_proposal() -> None:
    cluster = late()
    components = ({"name": "driver", "runsOn": ["Robot"]}, {"name": "planner", "replicas": 2})
    cluster.core.cluster.apply_app(app_object(*components, edges=[edge("planner", "driver")], generation=2))
    cluster.core.cluster.apply_pod(placed("planner", "e3", uid="second"))
    assert [node for _, node in cluster.run(SEEN_S + 2)] == [""]
    assert cluster.run(2 * ROUND_S) == []
    assert repr(cluster.watch) == "BudgetWatch(0 pods over budget or with a proposal)"


@pytest.mark.parametrize("recovers", [False, True])
def test_a_component_whose_budget_was_removed_loses_its_proposal_also_under_a_new_leader(recovers: bool) -> None:
    cluster = late()
    if recovers:
        cluster.rtt_ms = {"e1": 5.0}
        cluster.run(3)
    free = [{"topic": "/planner", "from": "planner", "to": "driver"}]
    cluster.core.cluster.apply_app(app_object(*COMPONENTS, edges=free, generation=2))
    if not recovers:
        cluster.watch = cluster.new_watch()
    assert [node for _, node in cluster.run(ROUND_S + 2)] == [""]
    assert cluster.annotation is None


def test_a_write_that_failed_is_made_again_within_seconds() -> None:
    cluster = Cluster()
    tried: list[float] = []
    for seq in range(round(FOR_S + REST_S)):
        cluster.clock.forward(1)
        measure(cluster.core, seq=seq)
        for write in cluster.watch.tick():
            tried.append(cluster.clock())
            cluster.watch.failed(write.pod.metadata.uid)
    assert len(tried) >= REST_S / SEARCH_S
    assert all(later - one <= RETRY_S[-1] + 1 for one, later in pairwise(tried))


def test_a_place_that_is_proposed_to_one_pod_is_proposed_to_no_other_also_by_a_new_leader_or_after_the_eviction() -> (
    None
):
    cluster = Cluster(placement={"reschedule": {"for": "1s", "when": "BudgetExceeded"}})
    cluster.rtt_ms = {"e3": 60.0}
    cluster.core.cluster.apply_pod(make_pod("load", node="e2", cpu="500m"))  # it has room for one
    assert [node for _, node in cluster.run(3)] == ["e2"]
    first = planner(cluster.core).pod
    many(cluster.core, 1, cpu="600m")
    assert cluster.run(REST_S) == []
    cluster.watch = cluster.new_watch()
    assert cluster.run(REST_S) == []
    ending = msgspec.structs.replace(first.metadata, deletion_timestamp="2026-01-02T03:02:00Z")
    cluster.core.cluster.apply_pod(msgspec.structs.replace(planner(cluster.core).pod, metadata=ending))
    assert cluster.run(2 * SEARCH_S) == [], "its grace"
    cluster.core.cluster.remove_pod(first)
    assert cluster.run(SUCCESSOR_S - 2) == []
    assert [node for _, node in cluster.run(RETRY_S[-1] + 3)] == ["e2"], "its successor did not come"


@pytest.mark.parametrize(
    ("reschedule", "found"),
    [({}, "e2"), ({"when": "BudgetExceeded", "maxPerDay": 0}, "e2"), ({"when": "BudgetExceeded"}, "")],
    ids=["never moves", "has no moves", "moves"],
)
def test_a_place_is_kept_from_an_app_that_moves_only_by_one_that_moves(reschedule: dict[str, Any], found: str) -> None:
    """e2 has room for one pod of 1 CPU, and e3 is too far. The other app is late as well."""
    placement = {"reschedule": {"for": "15s", "when": "BudgetExceeded"}}
    cluster = Cluster(more=(make_node("e0", cpu="4"),), placement=placement)
    core, other = cluster.core, {"app": "other", "app_uid": "app-2"}
    core.cluster.apply_pod(make_pod("filler", uid="filler", node="e2", cpu="1"))
    edges = [edge("watcher", "@robot")]
    theirs = {"reschedule": {"for": "1s", **reschedule}}
    core.cluster.apply_app(app_object({"name": "watcher"}, uid="app-2", name="other", edges=edges, placement=theirs))
    for owned in chain("watcher", **other):
        core.cluster.apply_owner(owned)
    core.cluster.apply_pod(member_pod("watcher", instance="amr", uid="w", node="e0", cpu="1", **other))
    cluster.rtt_ms = {"e0": 90.0, "e3": 60.0}
    cluster.run(60)
    better = cluster.annotation
    assert (parse_better_node(better).node if better else "") == found


def test_a_proposal_that_lasts_longer_than_any_of_ours_is_nobodys() -> None:
    """A tenant who may write on his own pod would keep a node from all others for ever."""
    cluster = late()
    forged = BetterNode("e2", "/planner to driver", 60_000.0, 8_000.0, datetime(9999, 1, 1, tzinfo=UTC))
    annotate(cluster.core, planner(cluster.core).pod, forged.text())
    cluster.run(FOR_S + REST_S + 2)
    assert (found := parse_better_node(cluster.annotation or ""))
    assert found.expires <= START + timedelta(seconds=cluster.clock()) + VALID


def test_a_place_that_another_pod_takes_is_looked_at_at_once() -> None:
    cluster = late()
    cluster.run(REST_S)
    cluster.core.cluster.apply_pod(make_pod("load", node="e2", cpu="1500m"))
    assert [node for _, node in cluster.run(1)] == ["e3"]


def test_a_proposal_outlasts_the_restart_of_another_pod_of_the_app_but_not_its_absence() -> None:
    cluster = late()
    cluster.core.cluster.remove_pod(placed("driver", "amr"))
    assert cluster.run(FOR_S) == []
    cluster.core.cluster.apply_pod(placed("driver", "amr", uid="again"))
    assert cluster.run(100) == []
    cluster.core.cluster.remove_pod(placed("driver", "amr", uid="again"))
    assert [node for _, node in cluster.run(FOR_S + 2)] == [""]


def test_pods_that_are_gone_are_forgotten() -> None:
    cluster = late()
    cluster.core.cluster.remove_pod(planner(cluster.core).pod)
    assert cluster.run(3) == []
    assert repr(cluster.watch) == "BudgetWatch(0 pods over budget or with a proposal)"


# --- How much ---------------------------------------------------------------------------------------------------------


def many(core: SchedulerCore, count: int, *, cpu: str = "1m") -> None:
    """More apps of the same kind, all late."""
    for i in range(count):
        uid, name = f"many-{i}", f"many-{i}"
        app = app_object(
            {"name": "planner"}, name=name, uid=uid, edges=[edge("planner", "@robot")],
            placement={"reschedule": {"for": "1s"}},
        )  # fmt: skip
        core.cluster.apply_app(app)
        for owned in chain("planner", app=name, app_uid=uid):
            core.cluster.apply_owner(owned)
        pod = member_pod("planner", app=name, app_uid=uid, instance="amr", node="e1", cpu=cpu, memory="1Mi")
        core.cluster.apply_pod(pod)


def test_a_tick_looks_at_few_instances_and_searches_for_one_component(monkeypatch: Any) -> None:
    cluster = Cluster(placement={"reschedule": {"for": "1s"}})
    many(cluster.core, 3 * LOOKS)
    looks: list[str] = []
    searches: list[str] = []

    def looked(part: Any, *rest: Any) -> Any:
        looks.append(part.pod.metadata.uid)
        return over_budget(part, *rest)

    def searched(core: Any, part: Any, late: Any, **fields: Any) -> Any:
        searches.append(part.pod.metadata.uid)
        return better_node(core, part, late, **fields)

    monkeypatch.setattr(f"{WATCH}.over_budget", looked)
    monkeypatch.setattr(f"{WATCH}.better_node", searched)
    for _ in range(60):
        cluster.clock.forward(TICK_S)
        looks.clear()
        count = len(searches)
        cluster.watch.tick()
        assert len(looks) <= LOOKS + 3, "and the search of one: before it, and for two nodes at the most"
        assert len(searches) - count <= 1
    assert len(searches) > 10
    assert len(set(searches)) == len(searches), "the one that waited longest comes first"


def test_a_bug_that_one_app_meets_keeps_no_other_from_its_proposal(monkeypatch: Any, caplog: Any) -> None:
    cluster = Cluster()
    many(cluster.core, 3)
    mine = planner(cluster.core).pod.metadata.uid

    def broken(part: Any, *rest: Any) -> Any:
        if part.pod.metadata.uid != mine:
            raise RuntimeError("bug")
        return over_budget(part, *rest)

    monkeypatch.setattr(f"{WATCH}.over_budget", broken)
    assert [node for _, node in cluster.run(FOR_S + 2)] == ["e2"]
    assert caplog.text.count("RuntimeError: bug") >= 3


def looks_of(monkeypatch: Any) -> list[str]:
    """Uids of the pods that are looked at from now on."""
    looks: list[str] = []

    def looked(part: Any, *rest: Any) -> Any:
        looks.append(part.pod.metadata.uid)
        return over_budget(part, *rest)

    monkeypatch.setattr(f"{WATCH}.over_budget", looked)
    return looks


def test_while_nothing_changes_nothing_is_looked_at_but_once_a_minute(monkeypatch: Any) -> None:
    cluster = Cluster()
    many(cluster.core, 20)
    cluster.rtt_ms = {"e1": 5.0}
    cluster.run(3)
    looks = looks_of(monkeypatch)
    for _ in range(round((ROUND_S - 3) / TICK_S)):
        cluster.clock.forward(TICK_S)
        cluster.watch.tick()
    assert looks == []
    cluster.clock.forward(4)
    cluster.watch.tick()
    assert len(set(looks)) == 21


def test_of_many_instances_those_are_looked_at_that_have_an_end_at_the_node_whose_times_changed(
    monkeypatch: Any,
) -> None:
    cluster = Cluster()
    cluster.rtt_ms = {"e1": 5.0}
    cluster.run(3)
    app = {"name": "planner"}
    for number, (node, robot) in enumerate((("e2", "another"), ("e3", "another"), ("e2", "amr"))):
        uid = f"other-{number}"
        cluster.core.cluster.apply_app(app_object(app, name=uid, uid=uid, edges=[edge("planner", "@robot")]))
        for owned in chain("planner", app=uid, app_uid=uid):
            cluster.core.cluster.apply_owner(owned)
        pod = member_pod("planner", app=uid, app_uid=uid, instance=robot, node=node, cpu="1m", memory="1Mi", uid=uid)
        cluster.core.cluster.apply_pod(pod)
    looks = looks_of(monkeypatch)
    cluster.watch.tick()
    assert sorted(looks) == ["other-0", "other-1", "other-2"], "their pods are new"
    looks.clear()
    cluster.core.cluster.apply_telemetry(telemetry("e3", rtt_ms={"e1": 3.0}, seq=1))
    cluster.watch.tick()
    assert looks == ["other-1"]
    looks.clear()
    cluster.core.cluster.apply_telemetry(telemetry("amr", rtt_ms={"e1": 6.0}, seq=99))
    cluster.watch.tick()
    assert sorted(looks) == ["other-2", "planner"], "the robot is an end also where no pod of the app is on it"


@given(
    st.lists(st.lists(st.sampled_from([5.0, 17.0, 19.0, 21.0, 60.0]), min_size=3, max_size=3), min_size=1, max_size=60)
)
def test_whatever_is_measured_a_pod_gets_two_writes_a_minute_at_most(rounds: Sequence[Sequence[float]]) -> None:
    cluster = Cluster(placement={"reschedule": {"for": "1s"}})
    for rtt_ms in rounds:
        cluster.rtt_ms = dict(zip(("e1", "e2", "e3"), rtt_ms, strict=True))
        cluster.run(5)
    proposals = [at_s for at_s, node in cluster.writes if node]
    assert all(later - sooner >= REST_S for sooner, later in pairwise(proposals))
    withdrawals = [at_s for at_s, node in cluster.writes if not node]
    assert len(withdrawals) <= len(proposals)
    assert all(write != after for (_, write), (_, after) in pairwise(cluster.writes))


def test_the_write_names_the_pod_as_it_was_seen_last() -> None:
    cluster = Cluster()
    pod = planner(cluster.core).pod
    seen = msgspec.structs.replace(pod, metadata=msgspec.structs.replace(pod.metadata, resource_version="77"))
    cluster.core.cluster.apply_pod(seen)
    found: list[AnnotationWrite] = []
    for seq in range(20):
        cluster.clock.forward(1)
        measure(cluster.core, seq=seq)
        found += cluster.watch.tick()
    assert [(write.pod.metadata.uid, write.pod.metadata.resource_version) for write in found] == [("planner", "77")]


# --- Many tenants -----------------------------------------------------------------------------------------------------

CROWD = 30
"""Late components of another tenant."""


@pytest.mark.parametrize("when", ["BudgetExceeded", "Never"])
def test_another_tenants_late_components_delay_a_search_by_a_turn_and_those_that_stay_come_last(
    when: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    searched: list[str] = []
    cluster = Cluster(placement={"reschedule": {"when": "BudgetExceeded"}})
    core = cluster.core
    monkeypatch.setattr(BudgetWatch, "_namespace_of", lambda _, app_uid: "victim" if app_uid == "app-1" else "crowd")
    monkeypatch.setattr(f"{WATCH}.better_node", lambda _, part, *__, **___: searched.append(part.app.uid))
    cluster.rtt_ms = {"e1": 5.0}
    cluster.run(2)
    for number in range(CROWD):
        name = f"crowd-{number}"
        placement = {"reschedule": {"when": when}}
        core.cluster.apply_app(
            app_object(*COMPONENTS, name=name, uid=name, edges=[edge("planner", "driver")], placement=placement)
        )
        for component, node in (("driver", "amr"), ("planner", "e3")):
            for owned in chain(component, app=name, app_uid=name):
                core.cluster.apply_owner(owned)
            where = {"nodeSelector": {"kubernetes.io/hostname": node}} if component == "driver" else {}
            core.cluster.apply_pod(
                member_pod(component, app=name, app_uid=name, instance="amr", node=node, cpu="1m", **where)
            )
    cluster.rtt_ms = {"e1": 5.0, "e3": 60.0}
    cluster.run(FOR_S + 2, step_s=TICK_S)
    assert {*searched} > {"crowd-0"}, "the crowd is searched for"
    cluster.rtt_ms = {"e1": 60.0, "e3": 60.0}
    cluster.run(FOR_S, step_s=TICK_S)
    searched.clear()
    monkeypatch.setattr(WatchedPod, "retry_s", lambda *_: 0.0)  # everything is due all the time
    cluster.run(16 * TICK_S, step_s=TICK_S)
    assert searched.count("app-1") >= 7, searched
    assert searched.count("app-1") < len(searched), "the others have turns, too"
