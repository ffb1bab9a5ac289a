"""Laws of endings: they follow from verdicts alone, whatever their order, and are final."""

from datetime import UTC, datetime

from hypothesis import given
from hypothesis import strategies as st

from robotapp_api.model.names import Reason
from robotapp_claims.rules.completion.endings import CompletionRules, JobState, find_ending

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
