"""`runs`: table, provenance, and failed runs once more."""

import json
from typing import Any

import pytest
from tests.unit.cli.running import INSTANCES, ROBOTAPPS, UID, Stage, pod, robotapp

Json = dict[str, Any]
JOBS = "batch/jobs"
DIGEST = "registry.example/sim@sha256:0123456789abcdef"


def sweep() -> Json:
    app = robotapp()
    app["spec"]["matrix"] = {"parameters": [{"name": name, "values": ["1"]} for name in ("speed", "seed")]}
    app["spec"]["components"] = [{"name": "sim", "image": "team/sim:1", "job": {}}]
    return app


def run_object(name: str, phase: str, **values: str) -> Json:
    return {
        "metadata": {"name": f"teleop-{name}", "namespace": "fleet", "labels": {"robotics.io/app-uid": UID}},
        "spec": {"app": "teleop", "appUID": UID, "instance": name, "matrix": dict(sorted(values.items()))},
        "status": {"phase": phase, "domain": 7},
    }


def job(name: str, *conditions: str, seconds: int = 0, component: str = "sim") -> Json:
    shown = [
        {
            "type": kind,
            "status": "True",
            "reason": "BackoffLimitExceeded",
            "message": "too often",
            "lastTransitionTime": "2026-01-01T00:01:00Z",
        }
        for kind in conditions
    ]
    status: Json = {"startTime": "2026-01-01T00:00:00Z", "conditions": shown, "failed": 2}
    if seconds:
        status["completionTime"] = f"2026-01-01T00:00:{seconds:02}Z"
    return {
        "metadata": {
            "name": f"teleop-{name}-{component}",
            "namespace": "fleet",
            "uid": f"uid-{name}-{component}",
            "labels": {
                "robotics.io/app-uid": UID,
                "robotics.io/instance": name,
                "robotics.io/component": component,
            },
            "annotations": {"robotics.io/spec-hash": "abc", "robotics.io/rendered-by": "0.1.0"},
        },
        "status": status,
    }


def ended_pod(name: str, code: int, *, created: int) -> Json:
    built = pod(
        f"pod-{name}-{created}",
        "sim",
        node="edge-1",
        instance=name,
        phase="Succeeded" if code == 0 else "Failed",
        containerStatuses=[
            {"name": "sim", "image": "team/sim:1", "imageID": DIGEST, "state": {"terminated": {"exitCode": code}}}
        ],
    )
    built["metadata"]["ownerReferences"] = [{"kind": "Job", "uid": f"uid-{name}-sim"}]
    built["metadata"]["creationTimestamp"] = f"2026-01-01T00:00:{created:02}Z"
    return built


def fill(stage: Stage) -> None:
    stage.add(ROBOTAPPS, sweep())
    stage.add(
        INSTANCES,
        run_object("b", "Failed", speed="1.5", seed="42"),
        run_object("a", "Completed", speed="0.5", seed="42"),
        run_object("c", "Pending", speed="2.5", seed="42"),
    )
    stage.add(JOBS, job("a", "Complete", seconds=40), job("b", "Failed"))
    stage.add("/pods", ended_pod("a", 0, created=1), ended_pod("b", 1, created=1), ended_pod("b", 137, created=9))


def test_each_run_has_its_values_duration_and_latest_exit_code(stage: Stage) -> None:
    fill(stage)
    assert [line.split() for line in stage.text("runs", "teleop").splitlines()] == [
        ["RUN", "VALUES", "PHASE", "DURATION", "EXIT"],
        ["a", "speed=0.5", "seed=42", "Completed", "40s", "0"],
        ["b", "speed=1.5", "seed=42", "Failed", "60s", "137"],
        ["c", "speed=2.5", "seed=42", "Pending"],
    ]


def test_provenance_has_what_a_run_was_run_with(stage: Stage) -> None:
    fill(stage)
    first, second, third = json.loads(stage.text("runs", "teleop", "-o", "json"))
    assert (first["run"], first["parameters"], first["seed"]) == ("a", {"speed": "0.5", "seed": "42"}, "42")
    assert (first["seconds"], first["endTime"], first["domain"]) == (40.0, "2026-01-01T00:00:40Z", 7)
    (only,) = first["jobs"]
    assert (only["specHash"], only["operatorVersion"], only["exitCode"]) == ("abc", "0.1.0", 0)
    assert only["pods"][0]["node"] == "edge-1"
    assert only["pods"][0]["images"] == [{"container": "sim", "image": "team/sim:1", "digest": DIGEST}]
    assert [each["exitCode"] for each in second["jobs"][0]["pods"]] == [1, 137]
    assert second["jobs"][0]["reason"] == "BackoffLimitExceeded: too often"
    assert (third["startTime"], third["jobs"]) == (None, [])


def test_a_run_that_was_started_again_has_how_often(stage: Stage) -> None:
    fill(stage)
    again = run_object("e", "Running", speed="4.5", seed="42")
    again["status"]["restarts"] = {"count": 1, "attempt": 3}
    third = job("e")
    third["metadata"]["annotations"]["robotics.io/attempt"] = "3"
    stage.add(INSTANCES, again)
    stage.add(JOBS, third)
    (line,) = (line for line in stage.text("runs", "teleop").splitlines() if line.startswith("e "))
    assert "Running, restarts: 1" in line
    runs = {run["run"]: run for run in json.loads(stage.text("runs", "teleop", "-o", "json"))}
    assert (runs["e"]["restarts"], runs["e"]["jobs"][0]["attempt"]) == (1, 3)
    assert (runs["a"]["restarts"], runs["a"]["jobs"][0]["attempt"]) == (0, 0)


@pytest.mark.parametrize("is_between_attempts", [False, True])
def test_the_duration_of_a_run_that_was_started_again_begins_with_its_first_attempt(
    stage: Stage, is_between_attempts: bool
) -> None:
    stage.add(ROBOTAPPS, sweep())
    again = run_object("a", "Pending" if is_between_attempts else "Completed")
    again["status"]["restarts"] = {"count": 1, "attempt": 1, "began": "2025-12-31T23:59:00Z"}
    second = job("a", "Complete", seconds=40)
    second["metadata"]["annotations"]["robotics.io/began"] = "2025-12-31T23:59:00Z"
    stage.add(INSTANCES, again)
    stage.add(JOBS, *([] if is_between_attempts else [second]))
    (run,) = json.loads(stage.text("runs", "teleop", "-o", "json"))
    assert run["startTime"] == "2025-12-31T23:59:00Z"
    assert is_between_attempts or run["seconds"] == 100.0


def test_what_somebody_writes_as_the_beginning_of_a_run_is_none(stage: Stage) -> None:
    stage.add(ROBOTAPPS, sweep())
    stage.add(INSTANCES, run_object("a", "Completed"))
    for text in ("yesterday", "2026-01-01T00:00:30Z"):
        strange = job("a", "Complete", seconds=40)
        strange["metadata"]["annotations"]["robotics.io/began"] = text
        stage.add(JOBS, strange)
        (run,) = json.loads(stage.text("runs", "teleop", "-o", "json"))
        assert run["seconds"] == 40.0


def scheduled_job(component: str, *conditions: str, seconds: int = 0, started: str = "") -> Json:
    built = job("a", *conditions, seconds=seconds, component=component)
    built["metadata"]["annotations"]["robotics.io/due-at"] = "2026-01-01T00:00:00Z"
    built["status"] |= {"startTime": started} if started else {}
    return built


def test_the_duration_of_an_app_that_has_only_schedules_is_that_of_its_last_run(stage: Stage) -> None:
    stage.add(ROBOTAPPS, sweep())
    stage.add(INSTANCES, run_object("a", "Running"))
    stage.add(JOBS, scheduled_job("sim", "Complete", seconds=40))
    (run,) = json.loads(stage.text("runs", "teleop", "-o", "json"))
    assert (run["seconds"], run["endTime"]) == (40.0, "2026-01-01T00:00:40Z")
    assert "Running, last run: Complete 40s" in " ".join(stage.text("runs", "teleop").split())
    stage.add(JOBS, scheduled_job("upload", "Failed", started="2026-01-01T00:00:50Z"))
    assert "Running, last run: upload Failed 10s" in " ".join(stage.text("runs", "teleop").split())


def test_runs_of_a_schedule_are_no_part_of_the_duration_of_other_jobs(stage: Stage) -> None:
    stage.add(ROBOTAPPS, sweep())
    stage.add(INSTANCES, run_object("a", "Completed"))
    nightly = scheduled_job("upload", "Complete", seconds=59, started="2025-12-31T22:00:00Z")
    stage.add(JOBS, job("a", "Complete", seconds=40), nightly)
    (run,) = json.loads(stage.text("runs", "teleop", "-o", "json"))
    assert (run["startTime"], run["seconds"]) == ("2026-01-01T00:00:00Z", 40.0)


def test_failed_runs_are_repeated_and_others_are_left_alone(stage: Stage) -> None:
    fill(stage)
    printed = stage.text("runs", "teleop", "--failed")
    assert "b: sim runs once more" in printed
    assert [key.name for key in stage.api.store.objects if key.collection == JOBS] == ["teleop-a-sim"]


def test_a_failed_job_is_repeated_also_where_others_wait_for_it_and_its_run_has_not_ended(stage: Stage) -> None:
    stage.add(ROBOTAPPS, sweep())
    stage.add(INSTANCES, run_object("a", "Pending"))
    stage.add(JOBS, job("a", "Failed"))
    assert "a: sim runs once more" in stage.text("runs", "teleop", "--failed")


def test_runs_of_a_refused_spec_are_answered_with_the_reason(stage: Stage) -> None:
    refused = {"type": "Accepted", "status": "False", "reason": "InvalidSpec", "message": "$(MATRIX_SPED) is none"}
    stage.add(ROBOTAPPS, {**sweep(), "status": {"conditions": [refused]}})
    stage.add(INSTANCES, run_object("a", "Failed"))
    assert "No job is made: $(MATRIX_SPED) is none" in stage.text("runs", "teleop")
    assert "no failed job; nothing was changed\nNo job is made" in stage.text("runs", "teleop", "--failed")


def test_all_jobs_of_a_failed_run_with_a_deadline_run_again_because_the_time_counts_from_the_first(
    stage: Stage,
) -> None:
    fill(stage)
    stage.add(ROBOTAPPS, sweep() | {"spec": sweep()["spec"] | {"completion": {"deadline": "10m"}}})
    stage.add(JOBS, job("b", "Complete", component="prepare"))
    printed = stage.text("runs", "teleop", "--failed")
    assert "b: prepare runs once more" in printed
    assert [key.name for key in stage.api.store.objects if key.collection == JOBS] == ["teleop-a-sim"]


def test_a_run_whose_second_attempt_runs_has_no_exit_code_yet(stage: Stage) -> None:
    fill(stage)
    stage.add(INSTANCES, run_object("d", "Running", speed="3.5", seed="42"))
    stage.add(JOBS, job("d"))
    stage.add("/pods", ended_pod("d", 1, created=1))
    (line,) = (line for line in stage.text("runs", "teleop").splitlines() if line.startswith("d "))
    assert "Running" in line
    assert line.split()[-1] != "1"
    (run,) = (run for run in json.loads(stage.text("runs", "teleop", "-o", "json")) if run["run"] == "d")
    assert (run["jobs"][0]["exitCode"], run["jobs"][0]["pods"][0]["exitCode"]) == (None, 1)


def test_what_somebody_writes_as_the_number_of_an_attempt_is_none(stage: Stage) -> None:
    fill(stage)
    strange = job("b", "Failed")
    strange["metadata"]["annotations"]["robotics.io/attempt"] = "two"
    stage.add(JOBS, strange)
    runs = {run["run"]: run for run in json.loads(stage.text("runs", "teleop", "-o", "json"))}
    assert runs["b"]["jobs"][-1]["attempt"] == 0


def test_an_app_without_jobs_is_told_so(stage: Stage) -> None:
    stage.add(ROBOTAPPS, robotapp())
    result = stage.run("runs", "teleop")
    assert result.exit_code == 4
    assert "no component with job" in result.output


def test_a_job_with_schedule_is_shown_with_its_due_time_and_never_repeated(stage: Stage) -> None:
    app = robotapp()
    app["spec"]["components"] = [{"name": "sim", "image": "x", "job": {}, "schedule": {"cron": "@daily"}}]
    stage.add(ROBOTAPPS, app)
    stage.add(INSTANCES, run_object("a", "Degraded"))
    last, mark = job("a", "Failed"), job("a", component="mark")
    last["metadata"]["annotations"]["robotics.io/due-at"] = "2026-01-01T00:00:00Z"
    mark["metadata"]["annotations"]["robotics.io/settled-at"] = "2026-01-01T00:00:00Z"
    stage.add(JOBS, last, mark)
    (run,) = json.loads(stage.text("runs", "teleop", "-o", "json"))
    assert [each["dueTime"] for each in run["jobs"]] == ["2026-01-01T00:00:00Z"]
    for arguments in (("runs", "teleop", "--failed"), ("restart", "teleop", "sim"), ("restart", "teleop")):
        refusal = stage.run(*arguments)
        assert refusal.exit_code == 1
        assert "sim runs when it is due, not before; kubectl robotapp info teleop has the time" in refusal.output
    assert len(names_of_jobs(stage)) == 2


@pytest.mark.parametrize("completion", [{}, None], ids=["ended by completion", "jobs alone"])
def test_restart_leaves_jobs_with_schedule_to_their_time_and_runs_the_others_again(
    stage: Stage, completion: Json | None
) -> None:
    app = robotapp()
    nightly = {"name": "upload", "image": "x", "job": {}, "schedule": {"cron": "@daily"}}
    app["spec"]["components"] = [{"name": "sim", "image": "x", "job": {}}, nightly]
    app["spec"] |= {} if completion is None else {"completion": completion}
    last = job("a", "Failed", component="upload")
    last["metadata"]["annotations"]["robotics.io/due-at"] = "2026-01-01T00:00:00Z"
    stage.add(ROBOTAPPS, app)
    stage.add(INSTANCES, run_object("a", "Failed"))
    stage.add(JOBS, last, job("a", "Complete"))
    assert stage.text("restart", "teleop").splitlines() == [
        "teleop: 1 job runs once more (sim)",
        "Those with schedule run when they are due",
        "Follow it: kubectl robotapp runs teleop",
    ]
    assert names_of_jobs(stage) == ["teleop-a-upload"]


def test_a_failed_job_with_schedule_beside_one_that_is_repeated_is_left_to_its_time(stage: Stage) -> None:
    stage.add(ROBOTAPPS, sweep())
    stage.add(INSTANCES, run_object("a", "Degraded"))
    nightly = job("a", "Failed", component="upload")
    nightly["metadata"]["annotations"]["robotics.io/due-at"] = "2026-01-01T00:00:00Z"
    stage.add(JOBS, job("a", "Failed"), nightly)
    assert stage.text("runs", "teleop", "--failed").splitlines() == [
        "a: sim runs once more",
        "Those with schedule run when they are due",
        "Follow it: kubectl robotapp runs teleop",
    ]
    assert names_of_jobs(stage) == ["teleop-a-upload"]


HINTS = [
    (("restart", "teleop"), "Follow it: kubectl robotapp runs teleop"),
    (("runs", "teleop", "--failed"), "Follow it: kubectl robotapp runs teleop"),
    (("suspend", "teleop"), "Start it again: kubectl robotapp resume teleop"),
]


@pytest.mark.parametrize(("arguments", "hint"), HINTS)
def test_a_hint_has_the_namespace_and_cluster_of_its_command_so_that_it_can_be_pasted(
    stage: Stage, arguments: tuple[str, ...], hint: str
) -> None:
    fill(stage)
    options = ("-n", "fleet", "--context", "x", "--kubeconfig", str(stage.kubeconfig))
    written = f"-n fleet --context x --kubeconfig {stage.kubeconfig}"
    assert f"{hint} {written}" in " ".join(stage.text(*arguments, *options).split())


def test_hints_of_errors_have_the_namespace_too(stage: Stage) -> None:
    stage.add(ROBOTAPPS, sweep() | {"spec": sweep()["spec"] | {"suspend": True}})
    assert "follow it: kubectl robotapp info teleop -w -n fleet" in stage.text("resume", "teleop", "-n", "fleet")
    assert "kubectl robotapp info teleop -n fleet has the reason" in stage.run("logs", "teleop", "-n", "fleet").output


def names_of_jobs(stage: Stage) -> list[str]:
    return sorted(key.name for key in stage.api.store.objects if key.collection == JOBS)


def test_restart_of_an_app_that_has_ended_runs_all_its_jobs_again(stage: Stage) -> None:
    fill(stage)
    assert stage.text("restart", "teleop").splitlines() == [
        "teleop: 2 jobs run once more (sim)",
        "Follow it: kubectl robotapp runs teleop",
    ]
    assert names_of_jobs(stage) == []


def test_restart_of_one_run_leaves_the_others_alone(stage: Stage) -> None:
    fill(stage)
    assert "1 job runs once more (sim)" in stage.text("restart", "teleop", "sim", "--robot", "a")
    assert names_of_jobs(stage) == ["teleop-b-sim"]


def test_restart_of_a_job_that_has_failed_takes_the_other_failed_ones_along_because_they_would_keep_the_run_ended(
    stage: Stage,
) -> None:
    app = sweep()
    app["spec"]["components"] += [{"name": name, "image": "x", "job": {}} for name in ("check", "prepare")]
    stage.add(ROBOTAPPS, app)
    stage.add(INSTANCES, run_object("b", "Failed"))
    stage.add(
        JOBS, job("b", "Failed"), job("b", "Failed", component="check"), job("b", "Complete", component="prepare")
    )
    assert "2 jobs run once more (check, sim)" in stage.text("restart", "teleop", "sim")
    assert names_of_jobs(stage) == ["teleop-b-prepare"]


def test_restart_of_a_job_in_an_ended_run_with_completion_begins_the_run_anew(stage: Stage) -> None:
    app = sweep()
    app["spec"] |= {"completion": {"deadline": "10m"}}
    app["spec"]["components"] += [{"name": "prepare", "image": "x", "job": {}}]
    stage.add(ROBOTAPPS, app)
    stage.add(INSTANCES, run_object("b", "Completed"))
    stage.add(JOBS, job("b", "Complete"), job("b", "Complete", component="prepare"))
    assert "2 jobs run once more (prepare, sim)" in stage.text("restart", "teleop", "sim")


def test_restart_leaves_the_jobs_of_an_app_alone_whose_other_components_run_on(stage: Stage) -> None:
    app = robotapp()
    app["spec"]["components"] += [{"name": "sim", "image": "x", "job": {}}]
    stage.add(ROBOTAPPS, app)
    stage.add(INSTANCES, run_object("b", "Running"))
    stage.add(JOBS, job("b", "Complete"))
    labels = {"robotics.io/component": "driver", "robotics.io/instance": "b", "robotics.io/app-uid": UID}
    deployment = {"metadata": {"name": "d", "namespace": "fleet", "uid": "u", "labels": labels}}
    stage.add("apps/deployments", deployment | {"spec": {"template": {"metadata": {}}}})
    printed = stage.text("restart", "teleop")
    assert "pods of 1 Deployment are replaced" in printed
    assert "Its jobs are left alone; to run one again: kubectl robotapp restart teleop COMPONENT" in printed
    assert names_of_jobs(stage) == ["teleop-b-sim"]
    assert "component sim of teleop: 1 job runs once more (sim)" in stage.text("restart", "teleop", "sim")
    assert names_of_jobs(stage) == []


def test_restart_of_a_job_that_is_not_there_yet_changes_nothing(stage: Stage) -> None:
    stage.add(ROBOTAPPS, sweep())
    stage.add(INSTANCES, run_object("a", "Pending"))
    result = stage.run("restart", "teleop", "sim")
    assert result.exit_code == 4
    assert "has no pod; kubectl robotapp info teleop has the reason" in result.output


def test_restart_deletes_no_job_that_would_not_be_made_again(stage: Stage) -> None:
    fill(stage)
    refused = {"type": "Accepted", "status": "False", "reason": "InvalidSpec", "message": "$(MATRIX_SPED) is none"}
    stage.add(ROBOTAPPS, {**sweep(), "status": {"conditions": [refused]}})
    result = stage.run("restart", "teleop")
    assert result.exit_code == 1
    assert "no job of teleop would be made, so none was deleted: $(MATRIX_SPED) is none" in result.output
    assert names_of_jobs(stage) == ["teleop-a-sim", "teleop-b-sim"]


def test_an_app_that_has_ended_has_nothing_to_stop_when_it_is_suspended(stage: Stage) -> None:
    stage.add(ROBOTAPPS, {**sweep(), "status": {"phase": "Completed"}})
    assert stage.text("suspend", "teleop").splitlines() == [
        "teleop is suspended; it had ended before, so it has no pods, domain or devices",
        "No job of it runs again until: kubectl robotapp resume teleop",
    ]
    refused = {"type": "Accepted", "status": "False", "reason": "InvalidSpec", "message": "mend it"}
    stage.add(ROBOTAPPS, {**sweep(), "status": {"phase": "Failed", "conditions": [refused]}})
    assert "its pods end" in stage.text("suspend", "teleop")
