"""Jobs of components that end: rendered, run once, replaced after an edit alone, ended with their instance."""

from datetime import UTC, datetime
from typing import Any

import msgspec
import pytest
from tests.support.factories import VERSION, component, make_app

from robotapp_api.model.names import Annotation, Label
from robotapp_operator.plan.diff.diff import Plan, plan, wanted_children
from robotapp_operator.plan.diff.jobs import judge_progress
from robotapp_operator.plan.render.child import DEPLOYMENT, JOB, Child
from robotapp_operator.plan.spec.dependencies import describe_wait, unmet_dependencies
from robotapp_operator.plan.spec.desired import App, Domain, desired_of
from robotapp_operator.plan.spec.objects import ChildRef, Deployment, Job

NOW = datetime(2026, 1, 1, 0, 1, tzinfo=UTC)
DOMAIN = Domain(7, "dds.default.c.7")
Observed = dict[ChildRef, Any]


def app_of(*parts: dict[str, Any], **spec: Any) -> App:
    return make_app(*parts or (component("save", job={}),), **spec)


def children_of(
    app: App, observed: Observed | None = None, *, domain: Domain | None = DOMAIN, running: bool = True
) -> list[Child]:
    observed = observed or {}
    progress = judge_progress(app, observed.values(), now=NOW)
    return wanted_children(
        desired_of(app, ""), domain=domain, parameters={}, running=running, observed=observed, progress=progress
    )


def job_child(app: App, observed: Observed | None = None, *, name: str = "save", **options: Any) -> Child:
    return next(
        child for child in children_of(app, observed, **options) if child.component == name and child.ref.kind == JOB
    )


def stored(
    app: App,
    *,
    name: str = "save",
    verdict: str = "",
    domain: Domain = DOMAIN,
    spec: dict[str, Any] | None = None,
    **meta: Any,
) -> Observed:
    """The Job as the API server has it, a minute old."""
    child = job_child(app, name=name, domain=domain)
    body = child.body(app, version=VERSION)
    body["metadata"] |= {
        "uid": f"uid-{name}",
        "resourceVersion": "1",
        "creationTimestamp": "2026-01-01T00:00:00Z",
        **meta,
    }
    body["spec"] |= spec or {}
    condition = {"type": verdict, "status": "True", "lastTransitionTime": "2026-01-01T00:00:30Z"}
    body["status"] = {"conditions": [condition] if verdict else []}
    return {child.ref: msgspec.convert(body, Job)}


def plan_of(app: App, observed: Observed, **options: Any) -> Plan:
    progress = judge_progress(app, observed.values(), now=NOW)
    wanted = children_of(app, observed, **options)
    return plan(app, wanted, observed, version=VERSION, settled={}, progress=progress)


def test_a_job_runs_one_pod_that_is_never_restarted_in_place_nor_replaced_while_it_may_run() -> None:
    spec = job_child(app_of(component("save", job={"backoffLimit": 2, "activeDeadlineSeconds": 60}))).spec
    assert {key: spec[key] for key in spec if key != "template"} == {
        "suspend": False,
        "completions": 1,
        "parallelism": 1,
        "backoffLimit": 2,
        "activeDeadlineSeconds": 60,
        "podReplacementPolicy": "Failed",
        "podFailurePolicy": {
            "rules": [{"action": "Ignore", "onPodConditions": [{"type": "DisruptionTarget", "status": "True"}]}]
        },
    }
    assert spec["template"]["spec"]["restartPolicy"] == "Never"


def test_a_job_that_is_as_wanted_is_left_alone_whether_it_runs_or_has_ended() -> None:
    app = app_of()
    assert not plan_of(app, stored(app))
    assert not plan_of(app, stored(app, verdict="Complete"))
    assert not plan_of(app, stored(app, verdict="Failed"))


@pytest.mark.parametrize("verdict", ["", "Complete", "Failed"])
def test_an_edit_of_the_component_replaces_its_job_once_its_pods_have_ended(verdict: str) -> None:
    before, after = app_of(), app_of(component("save", job={}, args=["--fast"]))
    observed = stored(before, verdict=verdict)
    result = plan_of(after, observed)
    assert [item.metadata.name for item in result.deletes] == [ref.name for ref in observed]
    assert not [change for change in result.changes if change.child.ref.kind == JOB]
    assert not plan_of(after, stored(before, deletionTimestamp="2026-01-01T00:00:50Z")).deletes
    (job,) = [change for change in plan_of(after, {}).changes if change.child.ref.kind == JOB]
    assert job.over is None


@pytest.mark.parametrize(
    "fields",
    [{"job": {"backoffLimit": 1}}, {"job": {}, "dependsOn": [{"component": "driver"}]}],
    ids=["limits", "order"],
)
def test_limits_and_order_do_not_run_a_job_that_has_ended_again(fields: dict[str, Any]) -> None:
    before, after = (app_of(component("save", **parts), component("driver")) for parts in ({"job": {}}, fields))
    result = plan_of(after, stored(before, verdict="Complete"))
    assert not [item for item in result.deletes if isinstance(item, Job)]


def test_another_domain_replaces_a_job_that_may_still_run_and_none_that_has_ended() -> None:
    app, other = app_of(component("save", job={}), component("driver")), Domain(8, "dds.default.c.8")
    assert [item for item in plan_of(app, stored(app), domain=other).deletes if isinstance(item, Job)]
    assert not [
        item for item in plan_of(app, stored(app, verdict="Complete"), domain=other).deletes if isinstance(item, Job)
    ]


def test_limits_and_suspension_are_changed_in_place_without_a_touch_of_the_template() -> None:
    before, after = app_of(), app_of(component("save", job={"backoffLimit": 1}))
    (change,) = plan_of(after, stored(before)).changes
    assert change.amended is not None
    assert change.amended["backoffLimit"] == 1
    assert change.amended["template"] == stored(before).popitem()[1].spec["template"]
    (stop,) = plan_of(before, stored(before), running=False).changes
    assert stop.amended is not None
    assert stop.amended["suspend"] is True


def test_an_instance_that_has_ended_keeps_its_jobs_alone_and_ends_those_that_still_run() -> None:
    app = app_of(
        component("driver"),
        component("save", job={}),
        component("other", job={}),
        completion={"success": {"operator": "Any"}},
    )
    observed = stored(app, verdict="Complete") | stored(app, name="other")
    assert {child.component for child in children_of(app, observed, domain=None)} == {"save", "other"}
    result = plan_of(app, observed, domain=None)
    (change,) = result.changes
    assert change.child.component == "other"
    assert change.amended is not None
    assert (change.amended["activeDeadlineSeconds"], change.amended["suspend"]) == (1, False)
    assert not result.deletes


def test_a_new_job_gets_what_is_left_of_the_deadline() -> None:
    parts = component("first", job={}), component("save", job={"activeDeadlineSeconds": 900})
    app = app_of(*parts, completion={"deadline": "10m"})
    assert job_child(app).spec["activeDeadlineSeconds"] == 600
    assert job_child(app, stored(app, name="first")).spec["activeDeadlineSeconds"] == 540
    progress, deadline = judge_progress(app, stored(app).values(), now=NOW), datetime(2026, 1, 1, 0, 10, tzinfo=UTC)
    assert progress.deadline == progress.find_change(NOW) == deadline
    assert progress.find_change(deadline) is None


def test_another_deadline_reaches_a_job_that_runs() -> None:
    def app_with(deadline: str, **job: int) -> App:
        return app_of(component("save", job=job), completion={"deadline": deadline})

    observed = stored(app_with("10m"))
    assert not plan_of(app_with("10m"), observed)
    assert not plan_of(app_with("10m2s"), observed)  # as much as a Job begins after its limit was computed
    for app, seconds in ((app_with("2h"), 7200), (app_with("2m"), 120), (app_with("2h", activeDeadlineSeconds=90), 90)):
        (change,) = plan_of(app, observed).changes
        assert change.amended is not None
        assert change.amended["activeDeadlineSeconds"] == seconds
        assert not plan_of(app, stored(app_with("10m"), spec={"activeDeadlineSeconds": seconds}))


def test_a_job_that_is_suspended_is_not_started_by_the_end_of_its_instance() -> None:
    app = app_of(component("save", job={}), component("other", job={}), completion={"success": {"operator": "Any"}})
    observed = stored(app, verdict="Complete") | stored(app, name="other", spec={"suspend": True})
    result = plan_of(app, observed, running=False)
    assert [item.metadata.labels[Label.COMPONENT] for item in result.deletes] == ["other"]
    assert not result.changes
    rest = stored(app, verdict="Complete")
    assert not plan_of(app, rest, running=False)


def test_the_deadline_of_a_suspended_app_starts_none_of_its_jobs() -> None:
    app = app_of(component("save", job={}), completion={"deadline": "30s"})
    assert not plan_of(app, stored(app, spec={"suspend": True}), running=False)


def test_what_waits_for_a_job_starts_when_it_is_complete_and_not_when_it_has_failed_or_is_to_run_again() -> None:
    after = [{"component": "save", "status": "Complete"}]
    app = app_of(component("save", job={}), component("planner", dependsOn=after))

    def waits(observed: Observed, of: App = app) -> bool:
        jobs = judge_progress(of, observed.values(), now=NOW).jobs
        return "planner" in unmet_dependencies(of, (), {}, jobs)

    assert waits({})
    assert waits(stored(app))
    assert waits(stored(app, verdict="Failed"))
    assert not waits(stored(app, verdict="Complete"))
    edited = app_of(component("save", job={}, image="other"), component("planner", dependsOn=after))
    assert waits(stored(app, verdict="Complete"), edited)
    assert describe_wait(app, ("save",)) == "waits until save is Complete (dependsOn)"


def test_a_newer_operators_job_for_this_very_spec_stands() -> None:
    app = app_of()
    observed = stored(app)
    (job,) = observed.values()
    job.metadata.annotations[str(Annotation.RUN_HASH)] = "as another version computes it"
    assert plan_of(app, observed).deletes
    job.metadata.annotations[str(Annotation.RENDERED_BY)] = "99.0.0"
    assert not plan_of(app, observed).deletes


def test_recordings_end_with_the_jobs() -> None:
    app = app_of(recordings=[{"name": "bag", "topics": {"regex": ".*"}}])
    assert app.completion_rules is not None
    assert app.completion_rules.jobs == {"save"}


def test_each_replica_with_an_ordinal_is_a_job_of_its_own() -> None:
    app = app_of(component("run", job={}, replicas=2, replicaIdentity="Ordinal"))
    assert [child.component for child in children_of(app) if child.ref.kind == JOB] == ["run-0", "run-1"]
    assert app.completion_rules is not None
    assert app.completion_rules.jobs == {"run-0", "run-1"}


def stored_deployment(app: App, **meta: Any) -> Observed:
    """The Deployment of a component before it became a job."""
    (child,) = (child for child in children_of(app) if child.ref.kind == DEPLOYMENT and child.component == "save")
    body = child.body(app, version=VERSION)
    body["metadata"] |= {"uid": "uid-deployment", "resourceVersion": "1", **meta}
    return {child.ref: msgspec.convert(body, Deployment)}


def kinds_made(result: Plan) -> list[str]:
    return [change.child.ref.kind for change in result.changes if change.child.component == "save"]


def test_a_component_that_becomes_a_job_has_its_first_pod_when_those_of_its_deployment_have_ended() -> None:
    before, now = app_of(component("save")), app_of()
    observed = stored_deployment(before)
    result = plan_of(now, observed)
    assert list(result.deletes) == list(observed.values())
    assert result.awaited == {"uid-deployment"}
    assert kinds_made(result) == []
    going = stored_deployment(before, deletionTimestamp="2026-01-01T00:01:00Z")
    result = plan_of(now, going)
    assert not result.deletes
    assert kinds_made(result) == []
    assert kinds_made(plan_of(now, {})) == [JOB]


def test_a_job_that_becomes_a_component_that_runs_on_ends_first() -> None:
    before, now = app_of(), app_of(component("save"))
    observed = stored(before)
    result = plan_of(now, observed)
    assert list(result.deletes) == list(observed.values())
    assert result.awaited == {"uid-save"}
    assert kinds_made(result) == []
    assert kinds_made(plan_of(now, stored(before, deletionTimestamp="2026-01-01T00:01:00Z"))) == []
    assert kinds_made(plan_of(now, {})) == [DEPLOYMENT]


def test_a_component_that_changes_its_mind_is_made_anew_when_its_last_pod_has_ended() -> None:
    app = app_of(component("save", image="reg/save:2"))
    going = stored_deployment(app_of(component("save")), deletionTimestamp="2026-01-01T00:01:00Z")
    result = plan_of(app, going)
    assert not result.deletes
    assert kinds_made(result) == []


def test_a_job_that_waits_for_others_has_its_deployment_end_with_its_pods_as_well() -> None:
    """Nothing takes its place yet, and its pods may still be there when something does."""
    after = [{"component": "map"}]
    now = app_of(component("map"), component("save", job={}, dependsOn=after))
    assert plan_of(now, stored_deployment(app_of(component("save")))).awaited == {"uid-deployment"}


def test_a_component_that_was_removed_keeps_nobody_waiting() -> None:
    observed = stored_deployment(app_of(component("save"), component("map")))
    result = plan_of(app_of(component("map")), observed)
    assert list(result.deletes) == list(observed.values())
    assert not result.awaited
