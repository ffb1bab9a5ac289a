"""The lease of a run on its apps: a killed run can be told from a living one."""

import threading
from contextlib import AbstractContextManager, nullcontext
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.unit.bridge.fake_cluster import app
from tests.unit.bridge.sequence_world import LIST, SequenceCluster

from rigel_bridge.cluster.deployment import deploy, roll_back
from rigel_bridge.cluster.kubectl import ClusterError, Refusal
from rigel_bridge.main import main
from rigel_bridge.sequences import lease
from rigel_bridge.sequences.lease import (
    LEASE_S,
    RENEW_EVERY_S,
    RENEWED,
    RUN,
    RUN_ID,
    Lease,
    State,
    in_background,
    state,
)
from rigel_bridge.sequences.run import annotated, read_summaries
from rigel_bridge.verbs import status

NOW = datetime(2026, 11, 22, 12, tzinfo=UTC)


def held(name: str = "teleop-demo", *, renewed: datetime | None = NOW) -> dict[str, Any]:
    """An app that another run made."""
    marks = Lease(SequenceCluster().cluster, "theirs", lambda: renewed or NOW).annotations("demo")
    if renewed is None:
        del marks[RENEWED]
    made = annotated(app(name), marks)
    made["metadata"] |= {"namespace": "fleet", "uid": "their-uid", "generation": 1}
    return made


def with_held(**options: Any) -> SequenceCluster:
    world = SequenceCluster()
    world.cluster.objects["robotapps", "teleop-demo"] = held(**options)
    return world


def renewing(world: SequenceCluster, *, times: int) -> None:
    """Another process renews the lease when the app is read, so many times; then it is killed."""
    operate = world.cluster.before

    def before(call: tuple[str, ...]) -> None:
        nonlocal times
        operate(call)
        present = world.cluster.objects.get(("robotapps", "teleop-demo"))
        if present and call[0] == "get" and times:
            times -= 1
            present["metadata"]["annotations"] = {**present["metadata"]["annotations"], RENEWED: f"renewal {times}"}

    world.cluster.before = before


def test_the_app_of_a_killed_run_is_removed_by_the_next_after_one_lease(tmp_path: Path) -> None:
    world = with_held()
    world.run(LIST, "demo", tmp_path, run_id="ours")
    assert world.apps() == []
    assert sum(world.slept) >= LEASE_S + 30, "the lease of the other run, and the work of this one"
    assert [each["outcome"] for each in read_summaries(tmp_path)] == ["ran"]


def test_the_app_of_a_living_run_is_never_touched(tmp_path: Path) -> None:
    world = with_held()
    renewing(world, times=5)
    with pytest.raises(ClusterError, match=r"is of a run that goes on.*choose another --name.*status teleop-demo"):
        world.run(LIST, "demo", tmp_path, run_id="ours")
    assert world.cluster.objects["robotapps", "teleop-demo"]["metadata"]["uid"] == "their-uid"
    assert world.built == [], "nothing is built for a run that cannot begin"
    assert sum(world.slept) <= LEASE_S
    assert [each["outcome"] for each in read_summaries(tmp_path)] == ["failed"]


def test_an_app_that_was_kept_makes_room_at_once(tmp_path: Path) -> None:
    world, without = with_held(renewed=None), SequenceCluster()
    world.run(LIST, "demo", tmp_path / "a", run_id="ours")
    without.run(LIST, "demo", tmp_path / "b", run_id="ours")
    assert world.slept == without.slept
    assert world.apps() == []


def test_a_run_that_begins_during_the_build_of_this_one_is_left_alone(tmp_path: Path) -> None:
    world = SequenceCluster()
    tools_of = world.tools

    def tools(**options: Any) -> Any:
        made = tools_of(**options)

        def build(words: Any) -> None:
            world.built.append(tuple(words))
            world.cluster.objects["robotapps", "teleop-demo"] = held()
            renewing(world, times=5)

        object.__setattr__(made, "rigel", build)
        return made

    world.tools = tools  # type: ignore[method-assign]
    with pytest.raises(ClusterError, match="is of a run that goes on"):
        world.run(LIST, "demo", tmp_path, run_id="ours")
    assert world.apps() == ["teleop-demo"]


def test_a_run_renews_its_apps_and_nobody_elses(tmp_path: Path) -> None:
    """Every sleep of the run is a moment at which the thread may work; the clock moves on by a second each time."""
    world, beats = SequenceCluster(), 0
    now = NOW
    work: list[Any] = []

    def background(each: Any) -> AbstractContextManager[None]:
        work.append(each)
        return nullcontext()

    def passing() -> datetime:
        nonlocal now
        now += timedelta(seconds=1)
        return now

    seen: list[str] = []
    operate = world.cluster.before

    def before(call: tuple[str, ...]) -> None:
        nonlocal beats
        operate(call)
        present = world.cluster.objects.get(("robotapps", "teleop-demo"))
        if call[0] == "patch" or not work:
            return
        beats += 1
        work[0]()
        if present:
            seen.append(present["metadata"]["annotations"][RENEWED])

    world.cluster.before = before
    world.run(LIST, "demo", tmp_path, run_id="ours", now=passing, in_background=background)
    assert len(set(seen)) > 3
    assert seen == sorted(seen)
    assert beats > len(seen), "before there is an app, nothing is patched"
    patches = [call for call in world.cluster.calls if call[0] == "patch"]
    assert patches
    assert all(call[2] == "teleop-demo" for call in patches)


def test_a_renewal_leaves_the_app_of_another_run_as_it_is() -> None:
    world = with_held()
    before = dict(world.cluster.objects["robotapps", "teleop-demo"]["metadata"]["annotations"])
    ours = Lease(world.cluster, "ours", lambda: NOW + timedelta(hours=1))
    ours.take(["teleop-demo"])
    ours.renew()
    ours.release()
    assert world.cluster.objects["robotapps", "teleop-demo"]["metadata"]["annotations"] == before
    theirs = Lease(world.cluster, "theirs", lambda: NOW + timedelta(hours=1))
    theirs.take(["gone", "teleop-demo"])
    theirs.renew()
    annotations = world.cluster.objects["robotapps", "teleop-demo"]["metadata"]["annotations"]
    assert annotations == {**before, RENEWED: "2026-11-22T13:00:00Z"}, "one app that is gone hinders no other"


@pytest.mark.parametrize("reason", [Refusal.FORBIDDEN, Refusal.UNREACHABLE])
def test_a_renewal_that_fails_ends_no_run(reason: Refusal, tmp_path: Path) -> None:
    world = SequenceCluster()
    world.cluster.refused["patch", "robotapps"] = reason
    world.run(LIST, "demo", tmp_path, keep=True)
    assert [each["outcome"] for each in read_summaries(tmp_path)] == ["ran"]


def test_a_kept_app_bears_no_lease(tmp_path: Path) -> None:
    world = SequenceCluster()
    world.run(LIST, "demo", tmp_path, run_id="ours", keep=True)
    annotations = world.cluster.objects["robotapps", "teleop-demo"]["metadata"]["annotations"]
    assert (annotations[RUN], annotations[RUN_ID], RENEWED in annotations) == ("demo", "ours", False)
    assert state({"metadata": {"annotations": annotations}}, NOW)[0] is State.ENDED


def test_a_rollback_of_a_kept_app_revives_no_run(tmp_path: Path) -> None:
    world = SequenceCluster()
    world.run(LIST, "demo", tmp_path, run_id="ours", keep=True)
    stored = world.cluster.objects["robotapps", "teleop-demo"]
    deploy(world.cluster, {**stored, "spec": {**stored["spec"], "suspend": True}}, tell=print)
    roll_back(world.cluster, "teleop-demo", number=None, approve=print, tell=print)
    annotations = world.cluster.objects["robotapps", "teleop-demo"]["metadata"]["annotations"]
    assert (annotations[RUN], annotations[RUN_ID], RENEWED in annotations) == ("demo", "ours", False)


def test_the_work_in_the_background_repeats_and_ends_with_its_block(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lease, "RENEW_EVERY_S", 0.001)
    three = threading.Semaphore(0)
    with in_background(three.release):
        for _ in range(3):
            assert three.acquire(timeout=60)
    assert not [each for each in threading.enumerate() if each.name == "run-lease"]


@given(st.integers(-100_000, 100_000))
def test_the_state_of_a_run_follows_from_its_last_renewal(age_s: int) -> None:
    found, words = state(held(renewed=NOW - timedelta(seconds=age_s)), NOW)
    expected = State.LOST if age_s > LEASE_S else State.UNCLEAR if age_s < -LEASE_S else State.RUNNING
    assert found is expected
    assert words.isprintable()


@given(st.text())
def test_any_text_in_the_annotation_has_a_state(text: str) -> None:
    state({"metadata": {"annotations": {RUN: "demo", RENEWED: text}}}, NOW)


@pytest.mark.parametrize(
    "annotations", [None, [], "x", {RUN: 1}, {RUN: "demo", RENEWED: 5}, {RUN: "demo", RENEWED: None}]
)
def test_annotations_of_any_shape_have_a_state(annotations: Any) -> None:
    found = {"metadata": {"name": "x", "annotations": annotations}}
    assert lease.sequence_of(found) in (None, "demo")
    assert state(found, NOW)[0] is State.ENDED
    assert not lease.goes_on(SequenceCluster().cluster, found, clock=SequenceCluster().tools().clock)


def test_a_living_run_is_renewed_several_times_within_a_lease() -> None:
    assert RENEW_EVERY_S * 3 < LEASE_S


@pytest.mark.parametrize(
    ("age_s", "expected"),
    [(0, "goes on, renewed 0 s ago"), (600, "it was killed or has no connection"), (None, "--keep left the app")],
)
def test_status_shows_whether_the_run_goes_on(
    age_s: int | None, expected: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(status, "_now", lambda: NOW)
    world = with_held(renewed=None if age_s is None else NOW - timedelta(seconds=age_s))
    monkeypatch.setattr(status, "kubectl_of", lambda _: world.cluster)
    main(["status", "teleop-demo"])
    headline, line, *_ = capsys.readouterr().out.splitlines()
    assert headline.startswith("robotapp/teleop-demo in namespace fleet")
    assert line.startswith("  run of sequence demo ")
    assert expected in line
    main(["status", "teleop-demo", "-o", "json"])
    assert expected in capsys.readouterr().out


def test_status_of_an_app_of_no_run_speaks_of_none(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    world = with_held()
    world.cluster.objects["robotapps", "teleop-demo"]["metadata"]["annotations"] = {}
    monkeypatch.setattr(status, "kubectl_of", lambda _: world.cluster)
    main(["status", "teleop-demo"])
    assert "run of sequence" not in capsys.readouterr().out


def test_a_comparison_points_out_the_run_that_has_not_ended(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "summary.json").write_text('{"sequence": "demo", "app": "teleop-demo", "outcome": "unfinished"}')
    assert main(["sequences", "--compare", str(tmp_path)]) == 77
    found = capsys.readouterr()
    assert "| outcome | unfinished |" in found.out
    assert found.err == "demo: its run goes on, or was killed; `rigel-bridge status teleop-demo` shows which\n"


def test_the_folder_of_a_run_that_was_killed_is_told_from_one_that_ended(tmp_path: Path) -> None:
    """SIGKILL lets nothing more happen: what stands in the folder while Rigel builds is what stays."""
    world = SequenceCluster()
    tools_of = world.tools
    during: list[Any] = []

    def tools(**options: Any) -> Any:
        made = tools_of(**options)
        object.__setattr__(made, "rigel", lambda _: during.append(read_summaries(tmp_path)))
        return made

    world.tools = tools  # type: ignore[method-assign]
    world.run(LIST, "demo", tmp_path)
    assert [each["outcome"] for each in during[0]] == ["unfinished"]
    assert [each["outcome"] for each in read_summaries(tmp_path)] == ["ran"]
