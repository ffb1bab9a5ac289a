"""Laws of restarts of an instance: whatever fails, and wherever the operator dies, the count holds and an end is final."""

from typing import Any

import msgspec
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support.factories import VERSION, component, make_app
from tests.unit.plan.jobs.test_jobs import DOMAIN, NOW

from robotapp_api.model.names import Label
from robotapp_claims.rules.completion.endings import find_ending
from robotapp_operator.plan.diff.attempts import COMPLETION_TIME_FIELD, RESTARTS_FIELD, render_attempt
from robotapp_operator.plan.diff.diff import plan, wanted_children
from robotapp_operator.plan.diff.jobs import Progress, judge_progress
from robotapp_operator.plan.render.child import JOB, Child
from robotapp_operator.plan.spec.desired import desired_of
from robotapp_operator.plan.spec.objects import ChildRef, Job

AT = "2026-01-01T00:00:30Z"
AFTER = [{"component": "a", "status": "Complete"}]


class Instance:
    """Jobs and the record as an API server has them. Each write of the operator is one step, after which it may die."""

    def __init__(self, *, max_restarts: int, ordered: bool, operator: str) -> None:
        parts = [component("a", job={}), component("b", job={}, **({"dependsOn": AFTER} if ordered else {}))]
        self.app = make_app(*parts, completion={"maxRestarts": max_restarts, "success": {"operator": operator}})
        self.jobs: dict[ChildRef, Job] = {}
        self.status: dict[str, Any] = {}
        self.attempts: set[int] = set()
        self.created = 0
        self.ended = False

    def judge(self) -> Progress:
        return judge_progress(self.app, self.jobs.values(), now=NOW, status=self.status)

    def operate(self, writes: int) -> bool:
        """Lets the operator make so many writes at most; returns whether it made any."""
        writes_made = 0
        following = self.judge().next_attempt
        if following is not None:
            self.status = {RESTARTS_FIELD: render_attempt(following)}
            writes_made += 1
        progress = self.judge()
        assert progress.next_attempt is None
        wanted = wanted_children(
            desired_of(self.app, ""),
            domain=DOMAIN,
            parameters={},
            running=True,
            observed=self.jobs,
            progress=progress,
        )
        result = plan(self.app, wanted, self.jobs, version=VERSION, settled={}, progress=progress)
        for item in result.deletes:
            if writes_made < writes and isinstance(item, Job):
                self.put(item, deletion_timestamp=AT)
                writes_made += 1
        for change in result.changes:
            if writes_made < writes and change.child.ref.kind == JOB and change.over is None:
                self.create(change.child)
                writes_made += 1
        return bool(writes_made)

    def create(self, child: Child) -> None:
        assert not self.ended, "nothing starts an instance whose domain was given back"
        body = child.body(self.app, version=VERSION)
        self.created += 1
        body["metadata"] |= {"uid": f"uid-{self.created}", "resourceVersion": "1", "creationTimestamp": AT}
        job = msgspec.convert(body, Job)
        self.jobs[child.ref] = job
        self.attempts.add(job.state.attempt)

    def put(self, job: Job, **meta: Any) -> None:
        metadata = msgspec.structs.replace(job.metadata, **meta)
        self.jobs[ChildRef(JOB, job.metadata.name)] = msgspec.structs.replace(job, metadata=metadata)

    def find(self, name: str) -> Job | None:
        return next((job for job in self.jobs.values() if job.metadata.labels[Label.COMPONENT] == name), None)

    def end(self, name: str, verdict: str) -> None:
        job = self.find(name)
        if job is not None and job.verdict is None and not job.is_deleting:
            body = {"conditions": [{"type": verdict, "status": "True", "lastTransitionTime": AT}]}
            self.jobs[ChildRef(JOB, job.metadata.name)] = msgspec.structs.replace(
                job, status=msgspec.convert(body, type(job.status))
            )

    def collect(self, name: str) -> None:
        """Removes a Job that is being deleted, as when its last pod has ended."""
        job = self.find(name)
        if job is not None and job.is_deleting:
            del self.jobs[ChildRef(JOB, job.metadata.name)]

    def publish(self) -> None:
        """Brings the status of the RobotAppInstance up to date."""
        progress = self.judge()
        record = render_attempt(progress.attempt)
        ended = {COMPLETION_TIME_FIELD: progress.ending.time} if progress.ending else {}
        self.status = ({RESTARTS_FIELD: record} if record else {}) | ended

    def sweep(self) -> None:
        """Judges as the sweep does, by Jobs of all attempts, also those that are being deleted."""
        rules = self.app.completion_rules
        assert rules is not None
        states = {job.metadata.labels[Label.COMPONENT]: job.state for job in self.jobs.values()}
        has_ended = find_ending(rules, states, now=NOW) is not None
        assert has_ended or not self.ended, "an end is final"
        self.ended = has_ended


NAMES = st.sampled_from(("a", "b"))
STEPS = st.one_of(
    st.tuples(st.just("operate"), st.integers(1, 3)),
    st.tuples(st.just("collect"), NAMES),
    st.tuples(st.just("end"), NAMES, st.sampled_from(("Complete", "Failed", "Failed"))),
    st.tuples(st.just("publish")),
    st.tuples(st.just("forget")),
)
INSTANCES = st.builds(
    Instance,
    max_restarts=st.integers(0, 2),
    ordered=st.booleans(),
    operator=st.sampled_from(("All", "Any")),
)


@settings(max_examples=60)
@given(INSTANCES, st.lists(STEPS, max_size=60))
def test_wherever_the_operator_dies_the_count_holds_and_an_end_is_final(
    instance: Instance, steps: list[tuple[Any, ...]]
) -> None:
    rules = instance.app.completion_rules
    assert rules is not None
    for what, *arguments in steps:
        if what == "forget":
            if instance.jobs:  # without any Job the record alone has the count
                instance.status = {}
        else:
            getattr(instance, what)(*arguments)
        instance.sweep()
        assert len(instance.attempts) <= rules.max_restarts + 1
    for _ in range(12 * (rules.max_restarts + 1)):
        instance.operate(9)
        for name in ("a", "b"):
            instance.collect(name)
        instance.operate(9)
        instance.end("a", "Failed")
        instance.end("b", "Failed")
        instance.publish()
        instance.sweep()
    assert instance.ended or instance.find("b") is None  # with Any, b waits for ever for a, which has failed
    assert not instance.operate(9)
