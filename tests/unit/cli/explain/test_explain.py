"""explain: the scheduler's records where they can be had, pod conditions otherwise, and it says which."""

import stat
from pathlib import Path
from typing import Any

import pytest
from tests.unit.cli.running import INSTANCES, ROBOTAPPS, Stage, instance, pod, robotapp

from robotapp_cli.commands.explain import InstanceView, Row, note_of
from robotapp_cli.reading.scheduler_link import Link

EDGE = {"topic": "/cmd_vel", "from": "panel", "to": "driver", "latency": {"budget": "30ms"}}
OBSERVED = {
    "topic": "/cmd_vel",
    "from": "panel",
    "to": "driver",
    "budget": "30ms",
    "p95": "45ms",
    "measured": False,
    "nodes": ["edge-1", "amr-07"],
}
SEEN = {"domain": 7, "components": [{"name": "panel", "message": "quota exceeded"}], "edges": [OBSERVED]}
RECORD: dict[str, Any] = {
    "node": "edge-1",
    "runnerUp": "edge-2",
    "refusals": [
        {
            "plugin": "LatencyFilter",
            "reason": "node(s) exceeded the latency budget",
            "nodes": 1,
            "unit": "ms",
            "examples": [{"node": "cloud-1", "number": 61.0}],
        },
        {
            "plugin": "NodeAffinity",
            "reason": "node(s) didn't match",
            "nodes": 1,
            "unit": "",
            "examples": [{"node": "amr-08", "number": None}],
        },
    ],
    "edges": [
        {
            "what": "/cmd_vel to driver",
            "peerNode": "amr-07",
            "rttMs": 2.0,
            "budgetMs": 30.0,
            "source": "measured",
            "met": True,
        }
    ],
    "top": {"nodes": ["edge-1", "edge-2"], "totals": [1964, 1748]},
    "devices": [],
}
WAITING = {
    "type": "PodScheduled",
    "status": "False",
    "reason": "Unschedulable",
    "message": "0/5 nodes are available: 5 were full.",
}


@pytest.fixture
def placed(stage: Stage) -> Stage:
    stage.add(ROBOTAPPS, robotapp(edges=[EDGE]))
    stage.add(INSTANCES, instance(**SEEN))
    stage.add("/pods", pod("driver-1", "driver", node="amr-07"), pod("panel-1", "panel", node="edge-1"))
    stage.scheduler.records = {
        "panel-1": RECORD,
        "driver-1": {**RECORD, "node": "amr-07", "refusals": [], "runnerUp": None},
    }
    return stage


def test_each_component_has_its_node_and_the_refused_ones_with_reasons(placed: Stage) -> None:
    text = placed.text("explain", "teleop", "--scheduler-url", placed.scheduler.url)
    lines = text.splitlines()
    assert lines[0] == "fleet/teleop, robot amr-07, domain 7"
    assert lines[1].split("  ")[1:2] == ["COMPONENT"]
    assert lines[2].split() == ["driver", "amr-07"]
    assert lines[3].split() == [
        "panel",
        "edge-1",
        "edge-2",
        *["cloud-1:", "61.0", "ms", "to", "amr-07", ">", "30", "ms"],
    ]
    assert lines[4].strip() == "amr-08: didn't match"
    assert "45/30 ms" in text
    assert "!" in text, "an edge beyond its budget is marked"


def test_an_edge_nobody_measured_shows_the_schedulers_estimate_as_what_it_is(stage: Stage) -> None:
    unknown = {key: value for key, value in OBSERVED.items() if key != "p95"}
    stage.add(ROBOTAPPS, robotapp(edges=[EDGE]))
    stage.add(INSTANCES, instance(**SEEN | {"edges": [unknown]}))
    stage.add("/pods", pod("panel-1", "panel", node="edge-1"))
    guess = RECORD["edges"][0] | {"source": "estimated", "rttMs": 21.5}
    for peer, shown in (("amr-07", "21.5/30 ms"), ("elsewhere", "?/30 ms")):
        stage.scheduler.records = {"panel-1": RECORD | {"edges": [guess | {"peerNode": peer}]}}
        (edge,) = [
            line
            for line in stage.text("explain", "teleop", "--scheduler-url", stage.scheduler.url).splitlines()
            if "/cmd_vel" in line
        ]
        assert shown in edge
        assert edge.endswith("estimated" if peer == "amr-07" else "unknown")


def test_how_the_pods_were_planned_together_is_said_once(placed: Stage) -> None:
    why = "planned together with its group; no plan was better"
    for name, record in placed.scheduler.records.items():
        placed.scheduler.records[name] = {**record, "planned": why}
    assert placed.text("explain", "teleop", "--scheduler-url", placed.scheduler.url).count(why) == 1


def test_why_a_tier_of_runs_on_was_taken_is_said_for_the_component(placed: Stage) -> None:
    why = "no node of tier Edge was feasible: tier Robot is next in runsOn"
    name, record = next(iter(placed.scheduler.records.items()))
    placed.scheduler.records[name] = {**record, "tier": why}
    text = placed.text("explain", "teleop", "--scheduler-url", placed.scheduler.url)
    assert [line for line in text.splitlines() if line.endswith(f": {why}")]


def waiting_panel(stage: Stage, record: dict[str, Any], **condition: str) -> str:
    stage.add(ROBOTAPPS, robotapp(edges=[EDGE]))
    stage.add(INSTANCES, instance(**SEEN))
    stage.add("/pods", pod("panel-1", "panel", conditions=[WAITING | condition]))
    stage.scheduler.records = {"panel-1": RECORD | {"node": None, "runnerUp": None} | record}
    return stage.text("explain", "teleop", "--scheduler-url", stage.scheduler.url)


def test_a_pod_that_its_group_holds_back_is_told_so_before_the_nodes_it_cannot_use(stage: Stage) -> None:
    why = "all pods of the group are placed together or none, and driver has no node"
    text = waiting_panel(stage, {"feasible": 2, "message": why})
    assert text.index("all pods of the group") < text.index("cloud-1")


@pytest.mark.parametrize("reason", ["WaitingForGroup", "WaitingForPredecessor", "WaitingForDomain"])
def test_what_is_no_matter_of_nodes_is_said_beside_an_older_record(stage: Stage, reason: str) -> None:
    text = waiting_panel(stage, {"feasible": 0}, reason=reason, message="waiting for what is to come")
    assert "waiting for what is to come" in text
    assert "cloud-1" in text


def test_the_users_token_goes_to_the_scheduler(placed: Stage) -> None:
    placed.text("explain", "teleop", ROBOTAPP_SCHEDULER_URL=placed.scheduler.url)
    assert set(placed.scheduler.authorizations) == {"Bearer t0ken"}


def test_a_scheduler_on_this_machine_is_believed_without_a_certificate_anybody_signed(placed: Stage) -> None:
    assert "cloud-1: 61.0 ms" in placed.text("explain", "teleop", "--scheduler-url", placed.scheduler.tls_url)


@pytest.mark.parametrize(
    "host", ["scheduler.invalid", "127.evil.invalid", "127.0.0.1.evil.invalid", "localhost.invalid"]
)
def test_a_token_is_not_sent_without_encryption_to_another_machine(placed: Stage, host: str) -> None:
    text = placed.text("explain", "teleop", "--scheduler-url", f"http://{host}:10259")
    assert "is not encrypted" in text
    assert placed.scheduler.authorizations == []


@pytest.mark.parametrize("spelling", ["HTTP://", " http://", "Http://"])
def test_no_spelling_of_http_sends_a_token_without_encryption(placed: Stage, spelling: str) -> None:
    elsewhere = placed.scheduler.url.replace("127.0.0.1", "0.0.0.0").replace("http://", spelling)  # noqa: S104 - see below
    assert "is not encrypted" in placed.text("explain", "teleop", "--scheduler-url", elsewhere)
    assert placed.scheduler.authorizations == []


def test_another_machines_certificate_must_be_signed_by_somebody_known(placed: Stage) -> None:
    elsewhere = placed.scheduler.tls_url.replace("127.0.0.1", "0.0.0.0")  # noqa: S104 - an address that is not loopback's
    assert "does not answer: [SSL: CERTIFICATE_VERIFY_FAILED]" in placed.text(
        "explain", "teleop", "--scheduler-url", elsewhere
    )
    assert placed.scheduler.authorizations == []


def test_structured_output_says_where_it_comes_from(placed: Stage) -> None:
    found = placed.data("explain", "teleop", "--scheduler-url", placed.scheduler.url, "-c", "panel")
    assert (found["source"], found["note"]) == ("scheduler", "")
    (row,) = found["instances"][0]["components"]
    assert (row["node"], row["runnerUp"], row["scores"]) == ("edge-1", "edge-2", {"edge-1": 1964, "edge-2": 1748})


def test_what_the_scheduler_decided_again_to_answer_is_marked(placed: Stage) -> None:
    placed.scheduler.records["panel-1"] = {**RECORD, "recomputed": True}
    text = placed.text("explain", "teleop", "--scheduler-url", placed.scheduler.url)
    assert "No decision is on record of: panel. Shown is what the scheduler would decide now." in text
    assert placed.data("explain", "teleop", "--scheduler-url", placed.scheduler.url)["source"] == "scheduler"


def test_each_component_is_noted_once_and_one_note_hides_no_other() -> None:
    rows = [Row("driver", pod="d", recorded=True, recomputed=True), Row("nav", pod="n")]
    views = [InstanceView(robot, None, rows, []) for robot in ("amr-1", "amr-2")]
    assert note_of(Link(), views).splitlines() == [
        "No decision is on record of: driver. Shown is what the scheduler would decide now.",
        "The scheduler has no record (any more) of: nav.",
    ]


@pytest.mark.parametrize(
    ("conditions", "text"),
    [
        (
            [("Accepted", "False", "spec.ros2: wrong"), ("Allocated", "Unknown", "waits")],
            "no pod yet: spec.ros2: wrong",
        ),
        ([("Accepted", "True", ""), ("Allocated", "False", "domain 5 is taken")], "no pod yet: domain 5 is taken"),
        ([("Allocated", "True", ""), ("Ready", "False", "quota is used up")], "no pod yet: quota is used up"),
        ([("Allocated", "Unknown", "")], "no pod yet"),
        ([], "no pod yet: the operator has not seen the app; does it run? kubectl get deployments -A -l"),
    ],
)
def test_a_component_without_pods_says_what_keeps_them(
    stage: Stage, conditions: list[tuple[str, str, str]], text: str
) -> None:
    found = [dict(zip(("type", "status", "message"), item, strict=True)) for item in conditions]
    stage.add(ROBOTAPPS, robotapp(status={"conditions": found}))
    line = stage.text("explain", "teleop", "--scheduler-url", stage.scheduler.url).splitlines()[2]
    assert " ".join(line.split()).startswith(f"driver waiting {text}")


@pytest.mark.parametrize("suspends", ["app", "component"])
def test_a_component_that_shall_have_no_pod_is_suspended_and_does_not_wait(stage: Stage, suspends: str) -> None:
    app = robotapp(suspend=suspends == "app")
    app["spec"]["components"][0]["replicas"] = 0 if suspends == "component" else 1
    stage.add(ROBOTAPPS, app)
    stage.add(INSTANCES, instance())
    name = app["spec"]["components"][0]["name"]
    lines = stage.text("explain", "teleop", "--scheduler-url", stage.scheduler.url).splitlines()
    assert [line.split()[1] for line in lines if line.split()[:1] == [name]] == ["suspended"]


def test_wide_shows_the_scores(placed: Stage) -> None:
    assert "edge-1 1964, edge-2 1748" in placed.text(
        "explain", "teleop", "--scheduler-url", placed.scheduler.url, "-o", "wide"
    )


@pytest.mark.parametrize(("status", "text"), [(401, "answers 401 who are you"), (503, "answers 503")])
def test_a_scheduler_that_refuses_is_named_and_conditions_are_shown(placed: Stage, status: int, text: str) -> None:
    placed.scheduler.status = status
    output = placed.text("explain", "teleop", "--scheduler-url", placed.scheduler.url)
    assert text in output
    assert "Shown are pod conditions" in output


def test_a_scheduler_that_does_not_answer_is_asked_once(placed: Stage) -> None:
    output = placed.text("explain", "teleop", "--scheduler-url", "https://127.0.0.1:1")
    assert "https://127.0.0.1:1 does not answer: Connect call failed" in output
    assert "SSLContext" not in output
    assert "amr-07" in output


def test_whoever_asks_without_encryption_is_told_that_a_scheduler_speaks_https(placed: Stage) -> None:
    plain = placed.scheduler.tls_url.replace("https:", "http:")
    text = placed.text("explain", "teleop", "--scheduler-url", plain)
    assert f"{plain} does not answer: " in text
    assert "; a scheduler speaks https://." in text


@pytest.mark.parametrize("url", ["127.0.0.1:10259", "scheduler", "ftp://scheduler", "https://", "https://x:70000", ""])
def test_what_is_no_address_is_wrong_usage(placed: Stage, url: str) -> None:
    result = placed.run("explain", "teleop", "--scheduler-url", url)
    assert result.exit_code == 2
    assert f"{url!r} is no URL such as https://127.0.0.1:10259" in result.output


def test_without_a_scheduler_pod_the_condition_of_a_waiting_pod_is_shown(stage: Stage) -> None:
    stage.add(ROBOTAPPS, robotapp())
    stage.add(INSTANCES, instance(**SEEN))
    stage.add("/pods", pod("driver-1", "driver", conditions=[WAITING]))
    text = stage.text("explain", "teleop")
    assert "0/5 nodes are available: 5 were full." in text
    assert "waiting" in text
    assert "no scheduler pod runs in namespace robotapp-system" in text
    assert "quota exceeded" in text, "a component without a pod shows why"


def test_a_pod_without_a_record_is_said(placed: Stage) -> None:
    del placed.scheduler.records["panel-1"]
    assert "has no record (any more) of: panel" in placed.text(
        "explain", "teleop", "--scheduler-url", placed.scheduler.url
    )


def test_unknown_components_and_robots_are_not_found(placed: Stage) -> None:
    for option, value, known in (("-c", "nope", "driver, panel"), ("--robot", "nope", "amr-07")):
        result = placed.run("explain", "teleop", option, value)
        assert result.exit_code == 4
        assert f"it has: {known}" in result.stderr


def test_pods_of_an_instance_that_has_no_object_are_explained_all_the_same(placed: Stage) -> None:
    placed.add("/pods", pod("driver-2", "driver", node="amr-08", instance="amr-08"))
    text = placed.text("explain", "teleop", "--scheduler-url", placed.scheduler.url)
    assert "fleet/teleop, robot amr-08\n" in text
    assert "amr-08" in placed.text("explain", "teleop", "--robot", "amr-08", "--scheduler-url", placed.scheduler.url)


def test_an_object_of_another_app_of_the_same_name_is_not_ours(placed: Stage) -> None:
    placed.add(INSTANCES, instance("amr-09", uid="another"))
    assert "amr-09" not in placed.text("explain", "teleop", "--scheduler-url", placed.scheduler.url)


def test_what_keeps_one_instance_from_having_pods_is_said_before_what_is_said_of_the_app(stage: Stage) -> None:
    refused = {"type": "Accepted", "status": "False", "reason": "RobotNodeUnclear", "message": "amr-07 has two nodes"}
    busy = {"type": "Ready", "status": "False", "message": "1 of 2 instances are ready"}
    stage.add(ROBOTAPPS, robotapp(status={"conditions": [busy]}))
    stage.add(INSTANCES, instance(conditions=[refused]))
    assert "no pod yet: amr-07 has two nodes" in stage.text("explain", "teleop")


def test_of_an_app_of_many_robots_those_in_trouble_are_explained(placed: Stage) -> None:
    for number in range(20):
        phase = "Degraded" if number == 7 else "Running"
        placed.add(INSTANCES, instance(f"bot-{number:02}", phase=phase))
    placed.add(INSTANCES, instance(**SEEN, phase="Running"))
    url = placed.scheduler.url
    text = placed.text("explain", "teleop", "--scheduler-url", url)
    assert [line for line in text.splitlines() if line.startswith("fleet/teleop")] == ["fleet/teleop, robot bot-07"]
    assert "20 more instances are not shown: kubectl robotapp explain teleop --robot NAME; all of them: -o wide" in text
    assert len(placed.data("explain", "teleop", "--scheduler-url", url)["instances"]) == 21
    assert placed.text("explain", "teleop", "--scheduler-url", url, "-o", "wide").count("fleet/teleop, robot") == 21
    assert placed.text("explain", "teleop", "--robot", "amr-07", "--scheduler-url", url).startswith(
        "fleet/teleop, robot amr-07"
    )


def test_an_edge_that_is_no_topic_says_what_it_is(placed: Stage) -> None:
    placed.add(INSTANCES, instance(edges=[{**OBSERVED, "kind": "Service", "topic": "/plan"}]))
    assert "/plan (Service)" in placed.text("explain", "teleop", "--scheduler-url", placed.scheduler.url)


def test_an_app_without_pods_is_shown(stage: Stage) -> None:
    stage.add(ROBOTAPPS, robotapp())
    text = stage.text("explain", "teleop")
    assert (text.count("no pod yet"), text.count("as driver")) == (1, 1)


_RELEASE = "app.kubernetes.io/instance"


class TestPortForward:
    """kubectl is a script here; the real one needs a kubelet."""

    @pytest.fixture
    def with_scheduler_pod(self, placed: Stage) -> Stage:
        labels = {"app.kubernetes.io/component": "scheduler"}
        ports = [{"name": "health", "containerPort": 10259}]
        for name in ("sched-a", "sched-b"):
            metadata = {"name": name, "namespace": "robotapp-system", "labels": labels}
            placed.add(
                "/pods",
                {"metadata": metadata, "spec": {"containers": [{"ports": ports}]}, "status": {"phase": "Running"}},
            )
        lease = {
            "metadata": {"name": "robotapp-scheduler", "namespace": "robotapp-system"},
            "spec": {"holderIdentity": "sched-b"},
        }
        placed.add("coordination.k8s.io/leases", lease)
        return placed

    def kubectl(self, folder: Path, body: str) -> str:
        folder.mkdir()
        script = folder / "kubectl"
        script.write_text(f"#!/bin/sh\n{body}\n")
        script.chmod(script.stat().st_mode | stat.S_IXUSR)
        return f"{folder}:/usr/bin:/bin"

    def test_the_leaders_pod_is_asked_through_kubectl(self, with_scheduler_pod: Stage, tmp_path: Path) -> None:
        port = with_scheduler_pod.scheduler.tls_url.rpartition(":")[2]
        path = self.kubectl(
            tmp_path / "bin",
            f'echo "$@" > {tmp_path}/called; echo "Forwarding from 127.0.0.1:{port} -> 10259"; exec sleep 60',
        )
        text = with_scheduler_pod.text("explain", "teleop", "--context", "x", PATH=path)
        assert "cloud-1: 61.0 ms to amr-07 > 30 ms" in text
        assert (tmp_path / "called").read_text().split() == [
            "port-forward",
            "-n",
            "robotapp-system",
            "pod/sched-b",
            ":10259",
            "--context",
            "x",
        ]

    def test_a_pod_that_only_calls_itself_scheduler_gets_no_token(self, placed: Stage, tmp_path: Path) -> None:
        def add(name: str, release: str) -> None:
            labels = {"app.kubernetes.io/component": "scheduler"} | ({_RELEASE: release} if release else {})
            metadata = {"name": name, "namespace": "robotapp-system", "labels": labels}
            placed.add("/pods", {"metadata": metadata, "spec": {"containers": []}, "status": {"phase": "Running"}})

        path = self.kubectl(tmp_path / "bin", f"touch {tmp_path}/called; exit 1")
        add("nobodys", "")
        assert "which of nobodys in namespace robotapp-system is the scheduler is not certain" in placed.text(
            "explain", "teleop", PATH=path
        )
        add("ours", "robotapp")
        assert "which of nobodys, ours" in placed.text("explain", "teleop", PATH=path)
        lease = {
            "metadata": {"name": "robotapp-scheduler", "namespace": "robotapp-system"},
            "spec": {"holderIdentity": "ours-and-longer"},
        }
        placed.add("coordination.k8s.io/leases", lease)
        assert "is held by ours-and-longer, which is no running scheduler pod" in placed.text(
            "explain", "teleop", PATH=path
        )
        assert not (tmp_path / "called").exists()

    def test_who_may_not_read_the_lease_gets_a_pod_of_the_one_release(self, placed: Stage, tmp_path: Path) -> None:
        labels = {"app.kubernetes.io/component": "scheduler", _RELEASE: "robotapp"}
        metadata = {"name": "ours", "namespace": "robotapp-system", "labels": labels}
        placed.add("/pods", {"metadata": metadata, "spec": {"containers": []}, "status": {"phase": "Running"}})
        path = self.kubectl(tmp_path / "bin", "echo 'error: pods is forbidden' >&2; exit 1")
        text = placed.text("explain", "teleop", PATH=path)
        assert "port-forward to ours failed: error: pods is forbidden; ask for Role robotapp-ask-scheduler" in text

    def test_a_tunnel_that_ended_by_itself_hides_no_answer(self, with_scheduler_pod: Stage, tmp_path: Path) -> None:
        path = self.kubectl(tmp_path / "bin", 'echo "Forwarding from 127.0.0.1:1 -> 10259"')
        assert "does not answer" in with_scheduler_pod.text("explain", "teleop", PATH=path)

    def test_a_failing_kubectl_is_quoted(self, with_scheduler_pod: Stage, tmp_path: Path) -> None:
        path = self.kubectl(tmp_path / "bin", "echo 'error: pods is forbidden' >&2; exit 1")
        assert "port-forward to sched-b failed: error: pods is forbidden" in with_scheduler_pod.text(
            "explain", "teleop", PATH=path
        )

    def test_a_missing_kubectl_is_said(self, with_scheduler_pod: Stage, tmp_path: Path) -> None:
        assert "cannot be started" in with_scheduler_pod.text("explain", "teleop", PATH=str(tmp_path))
