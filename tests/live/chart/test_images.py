"""The Dockerfiles: non-root, from the lock file, only the component's own extra; the chart's arguments fit the programs."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from tests.live.chart.chart import Chart, Object, named, pod_spec

from robotapp_agent.labeller import main as labeller
from robotapp_agent.shell.options import parse as parse_agent
from robotapp_api.model.names import SCHEDULER_NAME, THESIS_SCHEDULER_NAME
from robotapp_operator.settings import parse as parse_operator
from robotapp_scheduler.config.flags import parse as parse_scheduler
from robotapp_scheduler.config.load import load as load_config
from robotapp_scheduler.plugins.registry import catalogue

ROOT = Path(__file__).resolve().parents[3]
FOREIGN = {
    "operator": ("numpy", "typer", "uvloop"),
    "scheduler": ("kopf", "typer", "rich"),
    "agent": ("aiohttp", "pydantic", "numpy", "kopf", "typer"),
    "console": ("kopf", "typer", "rich", "uvloop"),
}


def dockerfile(component: str) -> str:
    return (ROOT / component / "Dockerfile").read_text()


EXTRAS = {"agent": "driver"}
"""Where the image holds another extra than that of its name: agent and driver are two programs of one image."""


@pytest.mark.parametrize("component", FOREIGN)
def test_the_image_runs_as_the_user_the_chart_asks_for(component: str) -> None:
    lines = dockerfile(component).splitlines()
    assert "USER 65532:65532" in lines
    assert lines[-1] == f'ENTRYPOINT ["python", "-m", "robotapp_{component}"]'
    assert lines.index("USER 65532:65532") > max(index for index, line in enumerate(lines) if line.startswith("FROM"))


@pytest.mark.parametrize("component", FOREIGN)
def test_the_image_holds_the_locked_packages_of_its_extra_alone(component: str) -> None:
    extra = EXTRAS.get(component, component)
    assert f"--extra {extra} " in dockerfile(component)
    assert "--require-hashes" in dockerfile(component)
    command = [
        "uv",
        "export",
        "--frozen",
        "--offline",
        "--quiet",
        "--no-dev",
        "--no-emit-project",
        "--extra",
        extra,
    ]
    exported = subprocess.run(
        [Path(sys.executable).parent / command[0], *command[1:]], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout
    packages = {line.split("==")[0] for line in exported.splitlines() if "==" in line and not line.startswith(" ")}
    assert "httptools" in packages
    assert not set(FOREIGN[component]) & packages


@pytest.mark.parametrize("component", FOREIGN)
def test_every_package_of_the_wheel_is_copied(component: str) -> None:
    for package in (
        "crds/robotapp_api",
        "operator/robotapp_operator",
        "scheduler/robotapp_scheduler",
        "agent/robotapp_agent",
        "cli/robotapp_cli",
        "rigel_bridge/rigel_bridge",
    ):
        assert f"COPY {package} {package}" in dockerfile(component)


def container_of(objects: list[Object], kind: str, component: str) -> Any:
    (found,) = named(objects, kind, f"robotapp-{component}")["spec"]["template"]["spec"]["containers"]
    return found


@pytest.mark.live
def test_the_programs_understand_the_arguments_the_chart_gives(chart: Chart) -> None:
    given = {"operator.watchNamespaces": "{a,b}", "operator.sweepSeconds": "5", "operator.schedulerName": "other"}
    given |= {"agent.intervalSeconds": "5", "agent.labeller.enabled": "true", "agent.nfd.enabled": "true"}
    objects = chart.render(given)
    arguments = {name: pod_spec(objects, name)["containers"][0]["args"] for name in ("operator", "scheduler")}
    operator = parse_operator(arguments["operator"], {})
    assert (operator.namespaces, operator.sweep_seconds, operator.lease_namespace) == (("a", "b"), 5, "robotapp-system")
    assert operator.scheduler_name == "other"
    agent = parse_agent(container_of(objects, "DaemonSet", "agent")["args"], {})
    assert (agent.service, agent.host_root, agent.interval_seconds) == ("robotapp-agent", Path("/host"), 5)
    assert agent.key_dir == Path("/etc/robotapp-agent/key")
    assert labeller.parse(container_of(objects, "Deployment", "labeller")["args"]).log_format == "json"
    scheduler = parse_scheduler(arguments["scheduler"], {})
    assert (scheduler.config_map, scheduler.last_good_config_map) == (
        "robotapp-scheduler",
        "robotapp-scheduler-last-good",
    )


@pytest.mark.live
def test_the_scheduler_understands_the_configuration_the_chart_ships(chart: Chart, tmp_path: Path) -> None:
    shipped = tmp_path / "scheduler.yaml"
    shipped.write_text(named(chart.render(), "ConfigMap", "robotapp-scheduler")["data"]["scheduler.yaml"])
    config = load_config(shipped, catalogue=catalogue())
    assert set(config.scheduler_names) == {SCHEDULER_NAME, THESIS_SCHEDULER_NAME}
    assert config.warnings == ()
