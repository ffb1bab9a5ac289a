"""logs, exec, shell, restart, suspend, resume, -w, and options before the verb."""

import asyncio
import contextlib
import os
import subprocess
from collections.abc import AsyncIterator, Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from tests.unit.cli.running import ROBOTAPPS, STATUS, UID, Stage, pod, robotapp

from robotapp_cli.commands import watching
from robotapp_cli.failures import CliError
from robotapp_cli.reading.pods import AppPod
from robotapp_cli.reading.session import Options
from robotapp_cli.verbs import move_options
from robotapp_cli.working import entering, logs
from robotapp_cli.working.entering import build_exec_command
from robotapp_cli.working.logs import LogOptions, LogSource, build_query, choose_colour, list_sources
from robotapp_client.tools.rollout import RESTARTED_AT

Json = dict[str, Any]


def running_pod(name: str, component: str, *, robot: str = "amr-07", containers: tuple[str, ...] = ()) -> Json:
    names = containers or (component,)
    statuses = [{"name": name, "restartCount": 0, "state": {"running": {}}} for name in names]
    built = pod(name, component, node="edge-1", instance=robot, phase="Running", containerStatuses=statuses)
    built["spec"]["containers"] = [{"name": name} for name in names]
    return built


def deployment(name: str, labels: dict[str, str]) -> Json:
    return {
        "metadata": {
            "name": name,
            "namespace": "fleet",
            "uid": f"uid-of-{name}",
            "labels": {"robotics.io/app-uid": UID, **labels},
        },
        "spec": {"template": {"metadata": {}}},
    }


def line(second: int, text: str) -> str:
    return f"2026-01-01T00:00:{second:02d}.000000000Z {text}"


class TestLogs:
    def test_lines_of_all_pods_are_in_the_order_of_time(self, stage: Stage) -> None:
        stage.add(ROBOTAPPS, robotapp())
        stage.add("/pods", running_pod("a", "driver"), running_pod("b", "panel"))
        stage.api.logs = {("a", "driver"): [line(1, "one"), line(3, "three")], ("b", "panel"): [line(2, "two")]}
        assert stage.text("logs", "teleop").splitlines() == [
            "amr-07/driver | one",
            "amr-07/panel  | two",
            "amr-07/driver | three",
        ]

    def test_logs_that_are_cut_to_stay_within_memory_say_so(
        self, stage: Stage, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(logs, "MOST_BYTES_OF_ALL", 4096)
        monkeypatch.setattr(logs, "LEAST_BYTES", 1024)
        stage.add(ROBOTAPPS, robotapp())
        stage.add("/pods", running_pod("a", "driver"), running_pod("b", "panel"))
        stage.api.logs = {("a", "driver"): [line(1, "x" * 2048)], ("b", "panel"): [line(2, "short")]}
        last_line = stage.text("logs", "teleop").splitlines()[-1]
        assert last_line == "amr-07/driver | (only the first 2 KiB are shown; write a lower --tail, or --since)"

    def test_one_component_and_its_sidecar(self, stage: Stage) -> None:
        stage.add(ROBOTAPPS, robotapp())
        stage.add("/pods", running_pod("a", "driver", containers=("driver", "relay")), running_pod("b", "panel"))
        stage.api.logs = {("a", "driver"): [line(1, "one")], ("a", "relay"): [line(2, "two")]}
        assert stage.text("logs", "teleop", "driver").splitlines() == [
            "amr-07/driver       | one",
            "amr-07/driver/relay | two",
        ]

    def test_a_container_whose_log_is_refused_hides_no_other(self, stage: Stage) -> None:
        stage.add(ROBOTAPPS, robotapp())
        stage.add("/pods", running_pod("a", "driver"), running_pod("b", "panel"))
        stage.api.logs = {("a", "driver"): [line(1, "one")]}
        text = stage.text("logs", "teleop")
        assert "amr-07/driver | one" in text
        assert 'amr-07/panel  | (no log: container "panel" in pod "b" has no log' in text

    def test_text_of_a_program_never_commands_the_terminal(self, stage: Stage) -> None:
        stage.add(ROBOTAPPS, robotapp())
        stage.add("/pods", running_pod("a", "driver"))
        stage.api.logs = {("a", "driver"): [line(1, "\x1b[31mred\x1b[0m \x1b]0;title\x07 [bold]")]}
        text = stage.text("logs", "teleop")
        assert "\x1b" not in text
        assert "| red " in text
        assert "[bold]" in text, "what stands in brackets is text"

    def test_an_app_without_pods_is_answered_with_the_command_that_has_the_reason(self, stage: Stage) -> None:
        stage.add(ROBOTAPPS, robotapp(), robotapp("parked", suspend=True))
        result = stage.run("logs", "teleop", "--robot", "amr-09")
        assert result.exit_code == 4
        assert "teleop on robot amr-09 has no pod; kubectl robotapp info teleop has the reason" in result.stderr
        assert "kubectl robotapp resume parked" in stage.run("logs", "parked").stderr

    def test_an_unknown_component_is_answered_with_those_there_are(self, stage: Stage) -> None:
        stage.add(ROBOTAPPS, robotapp())
        result = stage.run("logs", "teleop", "camera")
        assert result.exit_code == 4
        assert "teleop has no component camera; it has: driver, panel" in result.stderr

    def test_a_time_that_is_none_is_refused(self) -> None:
        with pytest.raises(CliError, match="--since soon is no duration; write 90s, 10m or 2h"):
            build_query(LogOptions(since="soon"))
        assert build_query(LogOptions(since="10m", tail=-1))["sinceSeconds"] == "600"
        assert "tailLines" not in build_query(LogOptions(tail=-1))

    def test_containers_that_never_started_have_no_log_and_only_ended_runs_a_previous_one(self) -> None:
        statuses = [
            {"name": "driver", "restartCount": 0, "state": {"waiting": {"reason": "ImagePullBackOff"}}},
            {"name": "relay", "restartCount": 2, "state": {"waiting": {"reason": "CrashLoopBackOff"}}},
        ]
        app_pod = AppPod(pod("a", "driver", containerStatuses=statuses))
        assert [source.container for source in list_sources(app_pod)] == ["relay"]
        assert [source.container for source in list_sources(app_pod, previous=True)] == ["relay"]

    def test_a_source_has_the_same_colour_in_each_run(self) -> None:
        assert choose_colour("amr-07/driver") == choose_colour("amr-07/driver")

    def test_followed_logs_go_on_with_the_next_run_of_a_container(
        self, stage: Stage, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """The second look finds the container restarted; then the test ends it as Ctrl-C would."""
        looks = 0

        async def look(_: float) -> None:
            nonlocal looks
            looks += 1
            streams = {task for task in asyncio.all_tasks() if "_follow_source" in repr(task.get_coro())}
            await asyncio.wait(streams)
            if looks == 2:
                raise KeyboardInterrupt
            restarted_pod = running_pod("a", "driver")
            restarted_pod["status"]["containerStatuses"][0]["restartCount"] = 1
            stage.api.logs = {("a", "driver"): [line(1, "first run"), line(5, "second run")]}
            stage.add("/pods", restarted_pod)

        stage.add(ROBOTAPPS, robotapp())
        stage.add("/pods", running_pod("a", "driver"))
        stage.api.logs = {("a", "driver"): [line(1, "first run")]}
        monkeypatch.setattr(logs, "pause", look)
        result = stage.run("logs", "teleop", "-f", "--tail", "1")
        assert result.exit_code == 130
        assert [text.strip() for text in result.stdout.splitlines()] == [
            "amr-07/driver | first run",
            "amr-07/driver | second run",
        ]

    def test_a_followed_container_of_a_node_that_is_out_of_reach_goes_on_when_it_is_back(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """The API server answers with 502 as long as it does not reach the node's kubelet."""
        refusal = b'{"kind": "Status", "message": "dial tcp 192.0.2.7:10250: no route to host"}'
        client, printed = LogClient([(502, refusal), (502, refusal), (200, line(1, "here again").encode() + b"\n")]), []
        printer = SimpleNamespace(
            print=lambda log_line: printed.append(log_line.text), print_problem=lambda _, text: printed.append(text)
        )

        async def pause(_: float) -> None:
            """The next try is at once."""

        monkeypatch.setattr(logs, "pause", pause)
        session: Any = SimpleNamespace(client=client, home="fleet")
        asyncio.run(logs._follow_source(session, LogSource("a", "driver", "driver"), {}, printer))  # type: ignore[arg-type]
        assert printed == ["no log for now: dial tcp 192.0.2.7:10250: no route to host", "here again"]


class LogClient:
    """An API server with these answers, status and body."""

    def __init__(self, answers: list[tuple[int, bytes]]) -> None:
        self._answers = answers

    @contextlib.asynccontextmanager
    async def stream(self, *_: Any, **__: Any) -> AsyncIterator[Any]:
        """Opens a followed log."""
        status, body = self._answers.pop(0)

        async def read() -> bytes:
            return body

        async def deliver(take: Callable[[Sequence[bytes]], None]) -> None:
            take([body])

        yield SimpleNamespace(status=status, headers={}, read=read, deliver=deliver)


class TestEntering:
    @pytest.fixture
    def started(self, monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
        commands: list[list[str]] = []
        monkeypatch.setattr(entering, "_become", commands.append)
        return commands

    def test_a_program_runs_in_the_main_container_of_the_component(
        self, stage: Stage, started: list[list[str]]
    ) -> None:
        stage.add(ROBOTAPPS, robotapp())
        stage.add("/pods", running_pod("a", "driver", containers=("relay", "driver")), running_pod("b", "panel"))
        stage.text("exec", "teleop", "-c", "driver", "--", "ros2", "topic", "list", "--no-daemon")
        (command,) = started
        assert command[:3] == ["kubectl", "exec", "--stdin"]
        assert "--container=driver" in command
        assert command[command.index("--") - 1] == "a"
        assert command[-4:] == ["ros2", "topic", "list", "--no-daemon"]

    def test_several_pods_are_a_question_with_its_answer(self, stage: Stage, started: list[list[str]]) -> None:
        stage.add(ROBOTAPPS, robotapp())
        stage.add("/pods", running_pod("a", "driver"), running_pod("b", "driver", robot="amr-08"))
        result = stage.run("shell", "teleop", "driver")
        assert result.exit_code == 2
        assert "has several pods (amr-07/driver, amr-08/driver); name --robot" in result.stderr
        assert started == []
        stage.text("shell", "teleop", "driver", "--robot", "amr-08")
        assert started[0][started[0].index("--") - 1] == "b"

    def test_a_replica_with_an_ordinal_is_named_by_its_number_and_all_of_them_by_their_component(
        self, stage: Stage, started: list[list[str]]
    ) -> None:
        components = [{"name": "det", "image": "i", "replicas": 2, "replicaIdentity": "Ordinal"}]
        stage.add(ROBOTAPPS, robotapp(components=components))
        for number in range(2):
            replica = running_pod(f"pod-{number}", f"det-{number}")
            replica["metadata"]["labels"]["robotics.io/replica-of"] = "det"
            stage.add("/pods", replica)
        result = stage.run("shell", "teleop", "det")
        assert (result.exit_code, started) == (2, [])
        assert "has several pods (amr-07/det-0, amr-07/det-1); name one of these replicas" in result.stderr
        stage.text("shell", "teleop", "det-1")
        assert started[0][started[0].index("--") - 1] == "pod-1"
        assert "has no component det-2" in stage.run("shell", "teleop", "det-2").stderr

    def test_a_container_that_is_not_there_is_answered_with_those_there_are(
        self, stage: Stage, started: list[list[str]]
    ) -> None:
        stage.add(ROBOTAPPS, robotapp())
        stage.add("/pods", running_pod("a", "driver"))
        result = stage.run("shell", "teleop", "driver", "--container", "relay")
        assert (result.exit_code, started) == (4, [])
        assert "pod a has no container relay; it has: driver" in result.stderr

    def test_a_pod_that_does_not_run_is_said_with_the_command_that_has_the_reason(
        self, stage: Stage, started: list[list[str]]
    ) -> None:
        stage.add(ROBOTAPPS, robotapp())
        stage.add("/pods", pod("a", "driver", phase="Pending"))
        result = stage.run("shell", "teleop", "driver")
        assert (result.exit_code, started) == (4, [])
        assert "kubectl robotapp info teleop has the reason" in result.stderr

    def test_the_program_has_the_environment_of_the_containers_first_process(self, tmp_path: Path) -> None:
        """Here with this machine's shell, and a file in the place of the first process's environment."""
        environment = tmp_path / "environ"
        environment.write_bytes(b"AMENT_PREFIX_PATH=/ws/install:/opt/ros/jazzy\0TERM=none\0BAD-NAME=x\0TEXT=a b\n'c'\0")
        app_pod = AppPod(running_pod("a", "driver"))
        command = build_exec_command(Options(), app_pod, "driver", ["env", "-0"], is_terminal=False)
        program = command[command.index("--") + 1 :]
        local_program = [word.replace("/proc/1/environ", str(environment)) for word in program]
        done = subprocess.run(
            local_program, env={"PATH": os.environ["PATH"], "TERM": "xterm"}, capture_output=True, check=True
        )
        variables = dict(pair.split("=", 1) for pair in done.stdout.decode().split("\0") if pair)
        assert variables["AMENT_PREFIX_PATH"] == "/ws/install:/opt/ros/jazzy"
        assert variables["TEXT"] == "a b\n'c'"
        assert variables["ROS_SUPER_CLIENT"] == "TRUE"
        assert variables["TERM"] == "xterm"

    @pytest.mark.parametrize("field", ["hostPID", "shareProcessNamespace"])
    def test_the_first_process_of_others_lends_no_environment(self, field: str) -> None:
        """It is the pause container's or the node's, whose PATH knows none of the container's programs."""
        app_pod = AppPod(running_pod("a", "driver"))
        app_pod.obj["spec"][field] = True
        command = build_exec_command(Options(), app_pod, "driver", ["env"], is_terminal=False)
        assert not any("/proc/1/environ" in word for word in command)
        program = command[command.index("--") + 1 :]
        done = subprocess.run(program, env={"PATH": os.environ["PATH"]}, capture_output=True, text=True, check=True)
        assert "ROS_SUPER_CLIENT=TRUE" in done.stdout

    def test_an_image_without_bash_gets_the_shell_it_has(self, tmp_path: Path) -> None:
        for name in ("sh", "env"):
            (tmp_path / name).symlink_to(f"/bin/{name}")
        app_pod = AppPod(running_pod("a", "driver"))
        command = build_exec_command(Options(), app_pod, "driver", ["env"], is_terminal=False)
        program = command[command.index("--") + 1 :]
        done = subprocess.run(
            ["/bin/sh", *program[1:]], env={"PATH": str(tmp_path)}, capture_output=True, text=True, check=True
        )
        assert "ROS_SUPER_CLIENT=TRUE" in done.stdout


class TestChanges:
    def test_suspend_and_resume_change_one_field_and_tell_what_happens(self, stage: Stage) -> None:
        stage.add(ROBOTAPPS, robotapp())
        assert "keeps its domain and gives its devices back" in stage.text("suspend", "teleop")
        assert "nothing was changed" in stage.text("suspend", "teleop")
        assert stage.data("list")["items"][0]["spec"]["suspend"] is True
        assert "kubectl robotapp info teleop -w" in stage.text("resume", "teleop")
        assert stage.data("list")["items"][0]["spec"]["suspend"] is False

    def test_restart_marks_the_deployments_of_the_components_but_not_those_of_helpers(self, stage: Stage) -> None:
        stage.add(ROBOTAPPS, robotapp())
        stage.add(
            "apps/deployments",
            deployment("driver", {"robotics.io/component": "driver"}),
            deployment("panel", {"robotics.io/component": "panel"}),
            deployment("server", {"robotics.io/role": "discovery"}),
        )

        def marked() -> set[str]:
            objects = [obj for key, obj in stage.api.store.objects.items() if key.collection == "apps/deployments"]
            templates = {obj["metadata"]["name"]: obj["spec"]["template"]["metadata"] for obj in objects}
            return {name for name, metadata in templates.items() if RESTARTED_AT in metadata.get("annotations", {})}

        assert "pods of 1 Deployment are replaced" in stage.text("restart", "teleop", "driver")
        assert marked() == {"driver"}
        stage.text("restart", "teleop")
        assert marked() == {"driver", "panel"}
        stage.text("restart", "teleop", "discovery")
        assert marked() == {"driver", "panel", "server"}

    def test_a_component_that_is_named_like_a_helper_is_the_one_that_is_meant(self, stage: Stage) -> None:
        parts = [{"name": "master", "image": "i"}, {"name": "driver", "image": "i"}]
        helper = running_pod("roscore", "master")
        helper["metadata"]["labels"] |= {"robotics.io/role": "master", "robotics.io/component": ""}
        stage.add(ROBOTAPPS, robotapp(components=parts))
        stage.add("/pods", helper, running_pod("ours", "master"))
        stage.add(
            "apps/deployments",
            deployment("ours", {"robotics.io/component": "master"}),
            deployment("roscore", {"robotics.io/role": "master"}),
        )
        stage.api.logs = {("ours", "master"): [line(1, "ours")], ("roscore", "master"): [line(2, "roscore")]}
        assert stage.text("logs", "teleop", "master").splitlines() == ["amr-07/master | ours"]
        assert "pods of 1 Deployment are replaced" in stage.text("restart", "teleop", "master")

    def test_an_app_without_deployments_is_answered_with_the_command_that_has_the_reason(self, stage: Stage) -> None:
        stage.add(ROBOTAPPS, robotapp())
        assert "has no pod" in stage.run("restart", "teleop").stderr


class TestWatch:
    def test_a_page_is_shown_again_when_it_has_changed(self, stage: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
        rounds = 0

        async def sleep(_: float) -> None:
            nonlocal rounds
            rounds += 1
            if rounds == 1:
                stage.add(ROBOTAPPS, robotapp("second", status=STATUS))
            elif rounds == 3:
                raise KeyboardInterrupt

        stage.add(ROBOTAPPS, robotapp(status=STATUS))
        monkeypatch.setattr(watching, "is_terminal", lambda: True)
        monkeypatch.setattr(watching, "pause", sleep)
        result = stage.run("list", "-w")
        assert result.exit_code == 130
        assert result.stdout.count("teleop") == 2, "a page without a change is not shown again"
        assert result.stdout.count("second") == 1

    def test_only_a_terminal_is_watched(self, stage: Stage) -> None:
        result = stage.run("list", "-w")
        assert result.exit_code == 2
        assert "kubectl get robotapp -w -o json" in result.stderr


class TestOptionsBeforeTheVerb:
    @pytest.mark.parametrize(
        ("given", "moved"),
        [
            (["-n", "a", "list"], ["list", "-n", "a"]),
            (["--context=x", "-nfleet", "info", "teleop"], ["info", "--context=x", "-nfleet", "teleop"]),
            (["-A", "list", "-o", "wide"], ["list", "-A", "-o", "wide"]),
            (["--version"], ["--version"]),
            (["-n"], ["-n"]),
            (["-n", "a"], ["-n", "a"]),
            (["-n", "a", "exec", "t", "--", "ls", "-n", "b"], ["exec", "-n", "a", "t", "--", "ls", "-n", "b"]),
            ([], []),
        ],
    )
    def test_they_go_behind_it(self, given: list[str], moved: list[str]) -> None:
        assert move_options(given) == moved

    def test_the_namespace_before_the_verb_counts(self, stage: Stage) -> None:
        stage.add(ROBOTAPPS, robotapp("there", namespace="elsewhere"))
        assert "there" in stage.text("-n", "elsewhere", "list")
        assert stage.run("-n", "elsewhere", "nodes").exit_code == 2, "a command that has no namespace refuses it"
