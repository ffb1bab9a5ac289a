"""Laws of the turns of a sweep: an instance gives its turn away when it has ended and none of its jobs runs, at whatever time one looks."""

from datetime import timedelta

import msgspec
from hypothesis import given
from hypothesis import strategies as st
from tests.support.factories import component, make_app
from tests.unit.plan.jobs.test_jobs import NOW, stored

from robotapp_operator.plan.diff.attempts import Attempt
from robotapp_operator.plan.diff.jobs import judge_progress
from robotapp_operator.plan.diff.turns import find_end_of_turn
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.plan.spec.objects import Job

NAMES = ("calibrate", "save")
VERDICTS = st.sampled_from(("", "Complete", "Failed"))
COMPLETIONS = st.fixed_dictionaries(
    {"maxRestarts": st.integers(0, 2), "success": st.fixed_dictionaries({"operator": st.sampled_from(("All", "Any"))})},
    optional={"deadline": st.sampled_from(("1s", "10m", "2h"))},
)
JOBS = st.lists(
    st.tuples(st.sampled_from(NAMES), VERDICTS, st.integers(0, 1), st.booleans()),
    max_size=2,
    unique_by=lambda job: job[0],
)


def make_job(app: App, name: str, verdict: str, attempt: int, is_deleting: bool) -> Job:
    (job,) = stored(app, name=name, verdict=verdict).values()
    job.metadata.annotations.update(Attempt(attempt, attempt).annotations)
    deletion = "2026-01-01T00:00:40Z" if is_deleting else None
    result: Job = msgspec.structs.replace(
        job, metadata=msgspec.structs.replace(job.metadata, deletion_timestamp=deletion)
    )
    return result


@given(COMPLETIONS, JOBS, st.integers(-3600, 4 * 3600))
def test_a_turn_is_over_exactly_when_the_instance_has_ended_and_none_of_its_jobs_runs(
    completion: dict[str, object], states: list[tuple[str, str, int, bool]], seconds: int
) -> None:
    app = make_app(*(component(name, job={}) for name in NAMES), completion=completion)
    jobs = [make_job(app, *state) for state in states]
    now = NOW + timedelta(seconds=seconds)
    end = find_end_of_turn(app, jobs)
    runs = any(job.verdict is None for job in jobs)
    assert (end is not None and end <= now) == (not runs and judge_progress(app, jobs, now=now).ending is not None)


def test_a_turn_ends_at_the_deadline_although_a_job_that_waits_for_another_was_never_made() -> None:
    after = [{"component": "calibrate", "status": "Ready"}]
    parts = component("calibrate"), component("save", job={}), component("judge", job={}, dependsOn=after)
    app = make_app(*parts, completion={"deadline": "1h"})
    assert find_end_of_turn(app, stored(app, verdict="Complete").values()) == NOW + timedelta(minutes=59)


def test_a_job_that_somebody_else_made_under_the_labels_of_an_instance_keeps_no_turn() -> None:
    app = make_app(component("save", job={}))
    (job,) = stored(app, verdict="Complete").values()
    (other,) = stored(app, ownerReferences=[]).values()
    end = find_end_of_turn(app, [job])
    assert end is not None
    assert find_end_of_turn(app, [job, other]) == end
