"""Laws of endings: they follow from verdicts alone, whatever their order, and are final. What is to be started again has none."""

from datetime import UTC, datetime

from hypothesis import given
from hypothesis import strategies as st

from robotapp_api.model.names import Reason
from robotapp_claims.rules.completion.endings import CompletionRules, JobState, find_ending, find_failure, select_latest

NOW = datetime(2026, 1, 1, tzinfo=UTC)
NAMES = ("a", "b", "c", "d")
VERDICTS = st.sampled_from(("", "Complete", "Failed"))
SECONDS = st.integers(0, 59).map(lambda second: f"2026-01-01T00:00:{second:02}Z")


@st.composite
def job_states(draw: st.DrawFn) -> JobState:
    verdict = draw(VERDICTS)
    return JobState("2026-01-01T00:00:00Z", verdict=verdict, ended=draw(SECONDS) if verdict else "")


JOBS = st.dictionaries(st.sampled_from(NAMES), job_states())
RULES = st.builds(
    CompletionRules,
    st.sets(st.sampled_from(NAMES), min_size=1).map(frozenset),
    any_suffices=st.booleans(),
    deadline=st.none(),
    max_restarts=st.just(0),
)


@given(RULES, JOBS)
def test_all_need_every_job_and_any_needs_one(rules: CompletionRules, jobs: dict[str, JobState]) -> None:
    verdicts = {name: jobs[name].verdict if name in jobs else "" for name in rules.jobs}
    complete = [name for name, verdict in verdicts.items() if verdict == "Complete"]
    failed = [name for name, verdict in verdicts.items() if verdict == "Failed"]
    enough_complete, enough_failed = (1, len(verdicts)) if rules.any_suffices else (len(verdicts), 1)
    ending = find_ending(rules, jobs, now=NOW)
    if len(complete) >= enough_complete:
        assert ending is not None
        assert ending.reason is Reason.COMPLETED
    elif len(failed) >= enough_failed:
        assert ending is not None
        assert ending.reason is Reason.JOB_FAILED
    else:
        assert ending is None
    if ending is not None:
        assert ending.time == jobs[ending.component].ended


@given(RULES, JOBS, JOBS)
def test_an_ending_stays_when_further_jobs_end(
    rules: CompletionRules, jobs: dict[str, JobState], later: dict[str, JobState]
) -> None:
    """The operator ends the other jobs of an instance that has ended, so their verdicts must change nothing."""
    ending = find_ending(rules, jobs, now=NOW)
    settled = {name: job for name, job in jobs.items() if job.verdict}
    after = find_ending(rules, {**jobs, **later, **settled}, now=NOW)
    if ending is not None:
        assert after is not None
        assert after.is_success or not ending.is_success


@st.composite
def attempts(draw: st.DrawFn) -> JobState:
    restarts = draw(st.integers(0, 3))
    return draw(job_states())._replace(attempt=draw(st.integers(restarts, 4)), restarts=restarts)


ATTEMPTS = st.dictionaries(st.sampled_from(NAMES), attempts())
RESTARTING = st.builds(
    CompletionRules,
    st.sets(st.sampled_from(NAMES), min_size=1).map(frozenset),
    any_suffices=st.booleans(),
    deadline=st.none(),
    max_restarts=st.integers(0, 4),
)


@given(RESTARTING, ATTEMPTS)
def test_an_instance_ends_or_is_started_again_and_never_both(rules: CompletionRules, jobs: dict[str, JobState]) -> None:
    """Its domain is given back when it has ended, so nothing may start it then."""
    ending, failure = find_ending(rules, jobs, now=NOW), find_failure(rules, jobs, now=NOW)
    assert ending is None or failure is None
    at_once = find_ending(rules._replace(max_restarts=0), jobs, now=NOW)
    assert (ending or failure) is None if at_once is None else ending == at_once or failure is not None
    if failure is not None:
        assert at_once is not None
        assert failure.component == at_once.component
        assert at_once.reason is Reason.JOB_FAILED


@given(RESTARTING, ATTEMPTS)
def test_jobs_of_earlier_attempts_change_nothing(rules: CompletionRules, jobs: dict[str, JobState]) -> None:
    """They go one by one while the next attempt begins, and the sweep sees any part of them."""
    latest = select_latest(jobs)
    assert find_ending(rules, jobs, now=NOW) == find_ending(rules, latest, now=NOW)
    assert find_failure(rules, jobs, now=NOW) == find_failure(rules, latest, now=NOW)


@given(RESTARTING, st.dictionaries(st.sampled_from(NAMES), job_states()), st.data())
def test_an_instance_that_is_started_again_has_not_ended_at_any_step_of_it(
    rules: CompletionRules, jobs: dict[str, JobState], data: st.DataObject
) -> None:
    """Each job is deleted, and made again, at any moment: whoever looks meanwhile finds no ending."""
    if find_failure(rules, jobs, now=NOW) is None:
        return
    steps = data.draw(st.lists(st.sampled_from(sorted(jobs)), max_size=8))
    present: dict[str, JobState | None] = dict(jobs)
    for name in steps:
        gone = present[name] is None
        present[name] = JobState("2026-01-01T00:01:00Z", attempt=1, restarts=1) if gone else None
        seen = {key: job for key, job in present.items() if job is not None}
        assert find_ending(rules, seen, now=NOW) is None
