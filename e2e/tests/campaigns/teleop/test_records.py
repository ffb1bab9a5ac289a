"""The file of results: what is written is read again, and a run goes on where it was cut."""

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from campaigns.teleop import records, teleop
from campaigns.teleop.design import SEED, plan_turns
from campaigns.teleop.metrics import NO_TRIP, Figures
from campaigns.teleop.records import Deployment, Header, Journal, Load, RecordError, Session

HEADER = Header(seed=5, rounds=1, pilot=True)
SESSION = Session("2026-11-29T07:00:00+00:00", "abc", "2 cores", loaded=False, load_average=0.4)
TURNS = plan_turns(5, 1)
SHARES = st.floats(0, 1)
TIMES = st.floats(0, 1e6)
FIGURES = st.one_of(
    st.none(), st.just(NO_TRIP), st.builds(Figures, TIMES, TIMES, TIMES, TIMES, SHARES, st.integers(0), st.integers(0))
)
DEPLOYMENTS = st.builds(
    Deployment,
    turn=st.sampled_from(TURNS),
    session=st.integers(1, 9),
    began_at=st.just("2026-11-29T07:00:00+00:00"),
    node=st.sampled_from(["", "edge-1"]),
    helpers=st.dictionaries(st.text(), st.text(), max_size=2),
    figures=FIGURES,
    load=st.one_of(st.none(), st.builds(Load, TIMES, SHARES, SHARES)),
    trips_ms=st.lists(st.one_of(st.none(), TIMES), max_size=4).map(tuple),
    void=st.text(max_size=20),
)


def deployment(number: int, void: str = "") -> Deployment:
    return Deployment(TURNS[number - 1], 1, "2026-11-29T07:00:00+00:00", figures=NO_TRIP, void=void)


@given(st.lists(DEPLOYMENTS, max_size=4))
def test_what_is_written_is_read_again(deployments: list[Deployment]) -> None:
    results = records.read([records.to_line(one) for one in (HEADER, SESSION, *deployments)])
    assert (results.header, results.sessions, list(results.deployments)) == (HEADER, (SESSION,), deployments)


@given(st.lists(DEPLOYMENTS, min_size=1, max_size=3), st.data())
def test_a_file_that_was_cut_anywhere_behind_its_header_is_read_up_to_there(
    deployments: list[Deployment], data: st.DataObject
) -> None:
    lines = [records.to_line(one) for one in (HEADER, *deployments)]
    text = "".join(lines)
    cut = text[: data.draw(st.integers(len(lines[0]), len(text)))]
    whole = sum(len("".join(lines[: number + 1])) <= len(cut) for number in range(len(lines))) - 1
    assert list(records.read(cut.splitlines(keepends=True)).deployments) == deployments[:whole]


def test_void_deployments_are_to_be_made_again() -> None:
    results = records.read([records.to_line(one) for one in (HEADER, deployment(1), deployment(2, "interrupted"))])
    assert [turn.number for turn in results.list_pending(TURNS)] == list(range(2, 49))
    assert (results.count_void(TURNS[1]), results.count_void(TURNS[0])) == (1, 0)
    assert [one.turn.number for one in results.valid] == [1]


@pytest.mark.parametrize(
    ("lines", "problem"),
    [
        ([], "has no header"),
        ([records.to_line(SESSION)], "the first line must be the header"),
        ([records.to_line(HEADER), records.to_line(HEADER)], "line 2 .*a second header"),
        ([records.to_line(HEADER), "{}\n"], "line 2"),
        ([records.to_line(HEADER), '{"deployment": {}}\n'], "line 2"),
        (["[1]\n"], "line 1"),
        (['{"header": {"seeds": 1}}\n'], "line 1"),
        ([json.dumps({"other": {}}) + "\n"], "line 1"),
    ],
)
def test_a_file_of_something_else_is_refused(lines: list[str], problem: str) -> None:
    with pytest.raises(RecordError, match=problem):
        records.read(lines)


def test_a_file_with_results_is_only_gone_on_with_by_resume_and_with_its_own_header(tmp_path: Path) -> None:
    path = tmp_path / "eo2.jsonl"
    Journal.open(path, HEADER, resume=False).append(deployment(1))
    with pytest.raises(RecordError, match="--resume"):
        Journal.open(path, HEADER, resume=False)
    with pytest.raises(RecordError, match="was begun as"):
        Journal.open(path, Header(seed=6, rounds=1, pilot=True), resume=True)
    journal = Journal.open(path, HEADER, resume=True)
    journal.append(deployment(2))
    assert [one.turn.number for one in journal.results.valid] == [1, 2]
    assert records.read_file(path) == journal.results


def test_a_line_that_was_cut_is_removed_before_the_file_grows(tmp_path: Path) -> None:
    path = tmp_path / "eo2.jsonl"
    Journal.open(path, HEADER, resume=False)
    with path.open("a") as file:
        file.write(records.to_line(deployment(1))[:40])
    Journal.open(path, HEADER, resume=True).append(deployment(2))
    assert [one.turn.number for one in records.read_file(path).valid] == [2]


def test_a_pilot_never_has_the_seed_of_the_run_that_counts() -> None:
    assert teleop.choose_header(None, pilot=False).seed == SEED
    assert teleop.choose_header(None, pilot=True).seed != SEED
    with pytest.raises(RecordError, match="another one"):
        teleop.choose_header(SEED, pilot=True)


def test_a_deployment_is_told_in_a_line() -> None:
    assert "no round trip; operator side on no node" in teleop.describe(deployment(1))
    assert "void, the wall clock moved" in teleop.describe(deployment(1, "the wall clock moved"))
    figures = Figures(4.2, 5.0, 9.0, 12.0, missed_share=0.125, sent=160, answered=159)
    line = teleop.describe(
        Deployment(TURNS[0], 1, "", node="edge-2", figures=figures, load=Load(1.0, busy_share=0.5, steal_share=0.0))
    )
    assert line.endswith("on edge-2: p50 5.0, p95 9.0, p99 12.0 ms, missed 12.5%, first trip 4.2 s, machine 50% busy")
