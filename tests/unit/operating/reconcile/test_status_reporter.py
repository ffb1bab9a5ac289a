"""Statuses are written when they differ, and never for the wrong object."""

import json
from collections.abc import AsyncIterator
from datetime import UTC, datetime
from typing import Any

import pytest
from tests.support.apiserver import FakeApiServer
from tests.support.clients import client_for
from tests.support.factories import app_body, domain_claim, robots, telemetry
from tests.unit.operating.controlling import place

from robotapp_api.model.app.status import RobotAppStatus
from robotapp_api.model.names import Reason
from robotapp_claims.rules.domain import DomainOutcome
from robotapp_client import ApiClient
from robotapp_client.api.resources import ROBOTAPPS
from robotapp_operator.plan.spec.record import parse_record
from robotapp_operator.plan.status.pace import BURST, CROWD_REST_S, START_REST_S
from robotapp_operator.reconcile import observer, status_reporter
from robotapp_operator.reconcile.observer import Observer
from robotapp_operator.reconcile.reconcile_state import ReconcileState
from robotapp_operator.reconcile.status_reporter import Reporter, same_status, unreadable_status
from robotapp_operator.watch.cache import Cache

EACH = {"nodeSelector": {"matchExpressions": [{"key": "robotics.io/robot", "operator": "Exists"}]}}


class Recorder:
    def __init__(self) -> None:
        self.notes: list[tuple[str, str]] = []

    def event(self, regarding: Any, *, reason: str, note: str, action: str, warning: bool = False) -> None:
        assert regarding["kind"] == "RobotApp"
        assert action
        self.notes.append((reason, note if warning else note.lower()))


class ReportedServer:
    def __init__(self, api: FakeApiServer, client: ApiClient) -> None:
        self.api = api
        self.client = client
        self.cache = Cache()
        self.memory = ReconcileState()
        self.recorder = Recorder()
        self.today = datetime(2026, 1, 1, tzinfo=UTC)
        self.now_s = 0.0
        self.conflict = ""
        self.changed: list[tuple[str, str]] = []
        watching = Observer(
            self.cache,
            self.memory,
            clock=lambda: self.now_s,
            on_change=lambda uid, instance: self.changed.append((uid, instance)),
        )
        self.reporter = Reporter(
            client,
            self.cache,
            self.memory,
            watching,
            self.recorder,  # type: ignore[arg-type] - a double
            conflict_of=lambda _: self.conflict,
            clock=lambda: self.now_s,
            now=lambda: self.today,
        )

    async def app(self, **spec: Any) -> str:
        body = app_body(**spec)
        body["metadata"] = {"name": "teleop", "namespace": "default"}
        return self.cache.update_app(await self.client.create(ROBOTAPPS, body)).uid

    async def status(self) -> dict[str, Any]:
        found: dict[str, Any] = (await self.client.get(ROBOTAPPS, "teleop", namespace="default")).get("status", {})
        return found

    def patches(self) -> int:
        return sum(method == "PATCH" for method, _ in self.api.requests)


@pytest.fixture
async def world() -> AsyncIterator[ReportedServer]:
    async with FakeApiServer() as api, client_for(api.endpoint) as client:
        yield ReportedServer(api, client)


async def test_the_first_status_is_written_and_the_same_one_never_again(world: ReportedServer) -> None:
    uid = await world.app()
    await world.reporter.report(uid)
    assert (await world.status())["observedGeneration"] == 1
    await world.reporter.report(uid)
    world.today = datetime(2026, 1, 2, tzinfo=UTC)
    await world.reporter.report(uid)
    assert world.patches() == 1


async def test_a_conflict_over_a_claim_is_a_condition_and_one_event_until_it_is_over(world: ReportedServer) -> None:
    uid = await world.app()
    world.cache.claims.put(uid, "c", domain_claim(7, uid=uid))
    await world.reporter.report(uid)

    async def allocated() -> tuple[str, str]:
        (found,) = [item for item in (await world.status())["conditions"] if item["type"] == "Allocated"]
        return found["reason"], found["message"]

    world.conflict = "domain 7 of default is held by default/thief, but default/teleop runs with it"
    for _ in range(2):
        await world.reporter.report(uid)
    assert await allocated() == ("ClaimConflict", world.conflict)
    assert [note for note in world.recorder.notes if note[0] == "ClaimConflict"] == [("ClaimConflict", world.conflict)]
    world.conflict = ""
    await world.reporter.report(uid)
    assert (await allocated())[0] == "Allocated"


async def test_a_deployment_that_others_scaled_is_an_event_although_the_status_stays(world: ReportedServer) -> None:
    uid = await world.app()
    await world.reporter.report(uid)
    world.memory.of(uid).scaled["Deployment a was scaled by kubectl"] = None
    for _ in range(2):
        await world.reporter.report(uid)
    assert [note for reason, note in world.recorder.notes if reason == "ReplicasSetBack"] == [
        "Deployment a was scaled by kubectl"
    ]
    assert world.patches() == 1


async def test_a_change_is_written_once_more(world: ReportedServer) -> None:
    uid = await world.app()
    await world.reporter.report(uid)
    world.cache.claims.put(uid, "c", domain_claim(7, uid=uid))
    world.memory.of(uid).new_domains[""] = 7
    world.now_s += START_REST_S[0]
    await world.reporter.report(uid)
    assert (await world.status())["summary"]["domain"] == "7"
    assert world.patches() == 2
    assert ("DomainAllocated", "domain 7") in world.recorder.notes
    assert world.memory.of(uid).new_domains == {}


async def test_progress_is_written_more_seldom_where_many_apps_start(world: ReportedServer) -> None:
    uid = await world.app()
    await world.reporter.report(uid)
    for number in range(19):
        world.memory.crowd.note(f"other-{number}", starts=True, begins=True, now_s=world.now_s)
    world.cache.claims.put(uid, "c", domain_claim(7, uid=uid))
    world.now_s += START_REST_S[0]
    assert await world.reporter.report(uid) == pytest.approx(20 * CROWD_REST_S - START_REST_S[0])
    assert world.patches() == 1
    world.now_s += 20 * CROWD_REST_S - START_REST_S[0]
    await world.reporter.report(uid)
    assert world.patches() == 2


async def test_an_app_that_starts_is_in_the_crowd_until_it_is_gone(world: ReportedServer) -> None:
    uid = await world.app()
    await world.reporter.report(uid)
    assert world.memory.crowd.size(world.now_s) == 1
    world.memory.forget(uid)
    assert world.memory.crowd.size(world.now_s) == 0


async def test_a_fleet_is_told_of_as_its_domains_come_and_not_only_when_all_are_there(world: ReportedServer) -> None:
    world.cache.nodes.update(robots("a", "b"))
    uid = await world.app(robots=EACH)
    await world.reporter.report(uid)
    assert "2 of 2 instances wait" in json.dumps((await world.status())["conditions"])
    world.cache.claims.put(uid, "c", domain_claim(7, uid=uid, instance="a"))
    world.now_s += 5
    await world.reporter.report(uid)
    assert "1 of 2 instances waits" in json.dumps((await world.status())["conditions"])


async def test_a_restarted_operator_does_not_doubt_a_refusal_it_has_not_asked_about(world: ReportedServer) -> None:
    uid = await world.app()
    refused = DomainOutcome(Reason.DOMAIN_EXHAUSTED, "full")
    world.memory.of(uid).outcomes[""] = refused
    await world.reporter.report(uid)
    world.memory.forget(uid)
    await world.reporter.report(uid)
    assert world.patches() == 1
    world.memory.of(uid).outcomes[""] = refused
    await world.reporter.report(uid)
    assert world.patches() == 1


async def test_a_status_is_never_written_to_another_app_of_the_same_name(world: ReportedServer) -> None:
    old = await world.app()
    record = world.cache.apps[old]
    await world.client.delete(ROBOTAPPS, "teleop", namespace="default")
    await world.app()
    world.cache.apps[old] = record
    await world.reporter.report(old)
    assert await world.status() == {}


async def test_a_deleted_or_unknown_app_gets_none(world: ReportedServer) -> None:
    await world.reporter.report("nobody")
    uid = await world.app()
    await world.client.delete(ROBOTAPPS, "teleop", namespace="default")
    await world.reporter.report(uid)
    assert world.recorder.notes == []


async def test_refusals_and_dead_distributions_are_told(world: ReportedServer) -> None:
    uid = await world.app(ros={"distro": "iron"}, ros1={})
    await world.reporter.report(uid)
    assert {reason for reason, _ in world.recorder.notes} == {"InvalidSpec", "EolDistro"}


async def test_an_app_this_version_cannot_read_says_so(world: ReportedServer) -> None:
    uid = await world.app(components="none")
    await world.reporter.report(uid)
    status = await world.status()
    RobotAppStatus.model_validate(status)
    verdicts = {item["type"]: item["status"] for item in status["conditions"]}
    assert (verdicts["Accepted"], verdicts["Ready"], verdicts["Stalled"]) == ("False", "False", "True")
    assert "spec.components" in status["summary"]["message"]
    await world.reporter.report(uid)
    assert world.patches() == 1


async def test_a_restless_app_is_written_once_per_second_and_asks_for_a_later_look(world: ReportedServer) -> None:
    uid = await world.app()
    seen = []
    for number in range(100):
        world.now_s += 0.1
        world.conflict = f"conflict {number + 1}"
        before = world.patches()
        wait_s = await world.reporter.report(uid)
        if world.patches() == before:
            assert wait_s is not None
            assert wait_s <= 1.0
        else:
            seen.append(world.now_s)
    assert len(seen) <= BURST + 10
    world.now_s += 1.0
    await world.reporter.report(uid)
    assert "conflict 100" in json.dumps(await world.status())


async def test_an_app_that_starts_is_written_ever_more_seldom_until_something_happens(world: ReportedServer) -> None:
    uid = await world.app()
    seen = []
    for number in range(300):
        world.now_s += 0.1
        world.cache.claims.put(uid, "c", domain_claim(number + 1, uid=uid))
        before = world.patches()
        wait_s = await world.reporter.report(uid)
        if world.patches() != before:
            seen.append(world.now_s)
        else:
            assert wait_s is not None
            assert wait_s <= START_REST_S[-1]
    assert seen == pytest.approx([0.1, 1.2, 6.3, 21.4], abs=0.15)
    world.conflict = "held by another app"
    await world.reporter.report(uid)
    assert "held by another app" in json.dumps(await world.status())


async def test_a_new_generation_is_observed_at_once_however_restless_the_app_was(world: ReportedServer) -> None:
    uid = await world.app()
    for number in range(2 * BURST):
        world.cache.claims.put(uid, "c", domain_claim(number + 1, uid=uid))
        await world.reporter.report(uid)
    edited = await world.client.patch(ROBOTAPPS, "teleop", {"spec": {"suspend": True}}, namespace="default")
    world.cache.update_app(edited)
    assert await world.reporter.report(uid) is None
    assert (await world.status())["observedGeneration"] == 2


async def test_only_the_instance_that_changed_is_computed_anew(
    world: ReportedServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = [f"r-{number:02}" for number in range(20)]
    world.cache.nodes.update(robots(*names))
    uid = await world.app(robots=EACH)
    computed: list[str] = []
    real = observer.instance_facts

    def counted(app: Any, instance: Any, *args: Any, **kwargs: Any) -> Any:
        computed.append(instance.robot)
        return real(app, instance, *args, **kwargs)

    monkeypatch.setattr(observer, "instance_facts", counted)
    await world.reporter.report(uid)
    assert sorted(computed) == names
    computed.clear()
    world.cache.claims.put(uid, "c", domain_claim(7, uid=uid, instance="r-07"))
    await world.reporter.report(uid)
    assert computed == ["r-07"]
    assert world.changed == [(uid, "r-07")]


async def test_newer_figures_of_another_operator_stand(world: ReportedServer) -> None:
    edge = {"topic": "/t", "from": "operator", "to": "driver", "latency": {"budget": "90ms"}}
    uid = await world.app(edges=[edge])
    world.memory.of(uid).outcomes[""] = DomainOutcome(Reason.DOMAIN_EXHAUSTED, "full")
    place(world.cache, uid, operator="edge-1", driver="amr")
    mine = world.memory.of(uid)
    texts = []
    for ms in (40, 50, 60):
        # An instance of a large fleet may publish at any time; here the only one does.
        mine.instance("").rest.figures_s = float("-inf")
        world.cache.put_telemetry(telemetry("edge-1", amr=ms), now_s=0.0)
        world.cache.touch(uid, "")
        world.now_s += 5
        await world.reporter.report(uid)
        texts.append((await world.status())["summary"]["budget"])
    assert texts == ["40/90ms", "50/90ms", "50/90ms"], "the third has to wait"
    stored = await world.client.get(ROBOTAPPS, "teleop", namespace="default")
    theirs = json.loads(json.dumps(stored["status"]).replace("50/90ms", "60/90ms").replace("50ms of", "60ms of"))
    world.cache.update_app(await world.client.replace(ROBOTAPPS, stored | {"status": theirs}, subresource="status"))
    before = world.patches()
    assert await world.reporter.report(uid) is None
    assert world.patches() == before
    assert (await world.status())["summary"]["budget"] == "60/90ms"


async def test_an_app_of_which_nothing_changed_is_not_even_rendered(
    world: ReportedServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    uid = await world.app()
    for _ in range(2):
        await world.reporter.report(uid)
    monkeypatch.setattr(status_reporter, "render_status", None)
    assert await world.reporter.report(uid) is None


def test_fields_of_other_writers_do_not_count_as_difference() -> None:
    assert same_status({"phase": "Running"}, {"phase": "Running", "matrix": {"a": "b"}})
    assert not same_status({"phase": "Running"}, {"phase": "Pending"})
    assert not same_status({"phase": "Running"}, {})


def test_an_unreadable_status_keeps_its_times() -> None:
    record = parse_record(app_body(components="none"))
    first = unreadable_status(record, "2026-01-01T00:00:00Z")
    again = parse_record(app_body(components="none") | {"status": first})
    assert unreadable_status(again, "2026-02-01T00:00:00Z") == first
