"""The configuration in a ConfigMap, changed while pods flow, with the chart's rights."""

import json
import secrets
import urllib.request
from collections.abc import Iterator
from typing import Any

import pytest
import yaml

from campaigns.rigs.stage import Stage, nodes, pod
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane.product import start_scheduler
from robotapp_testbed.control_plane.servers import unverified
from robotapp_testbed.machines.nodes import edge
from robotapp_testbed.processes.process import Process

pytestmark = pytest.mark.live

SYSTEM = "/api/v1/namespaces/robotapp-system/configmaps"
GIVEN, KEPT = "robotapp-scheduler", "robotapp-scheduler-last-good"
ELECTION = {"leaseDuration": "15s", "renewDeadline": "10s", "retryPeriod": "500ms"}


def document(*, strategy: str = "LeastAllocated", **fields: Any) -> str:
    args = {"scoringStrategy": {"type": strategy, "resources": [{"name": "cpu", "weight": 1}]}}
    plugins = {"multiPoint": {"disabled": [{"name": "NodeResourcesBalancedAllocation"}]}}
    profile = {
        "schedulerName": "ros-aware-scheduler",
        "plugins": plugins,
        "pluginConfig": [{"name": "NodeResourcesFit", "args": args}],
    }
    head = {"apiVersion": "kubescheduler.config.k8s.io/v1", "kind": "KubeSchedulerConfiguration"}
    return yaml.safe_dump(head | {"leaderElection": ELECTION, "profiles": [profile]} | fields)


class Settings:
    """The two ConfigMaps of the chart."""

    def __init__(self, cp: ControlPlane) -> None:
        self._api = cp.api

    def give(self, text: str) -> None:
        self._api.patch(f"{SYSTEM}/{GIVEN}", {"data": {"scheduler.yaml": text}})

    def kept(self) -> str:
        return str((self._api.get(f"{SYSTEM}/{KEPT}").get("data") or {}).get("scheduler.yaml", ""))

    def told(self) -> list[str]:
        """Reasons of the events about the given one."""
        path = f"/apis/events.k8s.io/v1/namespaces/robotapp-system/events?fieldSelector=regarding.name={GIVEN}"
        return [event["reason"] for event in self._api.get(path)["items"]]


def start(cp: ControlPlane) -> Process:
    return start_scheduler(
        cp,
        name=f"scheduler-{secrets.token_hex(3)}",
        config_map=GIVEN,
        last_good_config_map=KEPT,
        insecure_explain=True,
        sweep_seconds=1,
        log_format="text",
    )


def get(process: Process, path: str) -> dict[str, Any]:
    with urllib.request.urlopen(f"{process.health_url}{path}", context=unverified()) as answer:  # noqa: S310 - our own
        found: dict[str, Any] = json.load(answer)
    return found


def configz(process: Process) -> dict[str, Any]:
    found: dict[str, Any] = get(process, "/configz")["kubescheduler.config.k8s.io"]
    return found


@pytest.fixture
def settings(installed_plane: ControlPlane) -> Iterator[Settings]:
    before = installed_plane.api.get(f"{SYSTEM}/{GIVEN}")["data"]
    found = Settings(installed_plane)
    found.give(document())
    yield found
    installed_plane.api.patch(f"{SYSTEM}/{GIVEN}", {"data": before})


@pytest.fixture
def following(installed_plane: ControlPlane, settings: Settings) -> Iterator[Process]:
    process = start(installed_plane)
    Stage.wait(lambda: settings.kept() == document(), what=process.log_text)
    yield process
    process.stop()


def test_while_pods_flow_another_strategy_takes_over_at_once_and_no_pod_is_lost(
    installed_plane: ControlPlane, stage: Stage, settings: Settings, following: Process
) -> None:
    """Spread before, packed after: with MostAllocated the fuller node wins every time."""
    with nodes(installed_plane, edge("edge-1", cpu="8"), edge("edge-2", cpu="8")):
        stage.create_pod(pod("weight", requests={"cpu": "2"}))
        fuller = stage.wait_bound("weight")
        for number in range(10):
            stage.create_pod(pod(f"before-{number}", requests={"cpu": "100m"}))
        digest = configz(following)["digest"]
        settings.give(document(strategy="MostAllocated"))
        for number in range(10):
            stage.create_pod(pod(f"during-{number}", requests={"cpu": "100m"}))
        stage.wait(lambda: configz(following)["digest"] != digest, what=following.log_text)
        for number in range(10):
            stage.create_pod(pod(f"after-{number}", requests={"cpu": "100m"}))
        bound = {item: stage.wait_bound(item) for item in names("before", "during", "after")}
        assert bound["before-0"] != fuller
        assert len({bound[item] for item in names("after")}) == 1, "packed on one node"
        stage.wait(lambda: settings.kept() == document(strategy="MostAllocated"), what=settings.kept)
        stage.wait(lambda: "ConfigReloaded" in settings.told(), what=settings.told)


def names(*kinds: str) -> list[str]:
    return [f"{kind}-{number}" for kind in kinds for number in range(10)]


def test_a_bad_configuration_and_one_that_needs_a_restart_leave_the_old_one_at_work(
    installed_plane: ControlPlane, stage: Stage, settings: Settings, following: Process
) -> None:
    with nodes(installed_plane, edge("edge-1")):
        digest = configz(following)["digest"]
        settings.give(document(parallelism=0, typo=True))
        stage.wait(lambda: configz(following)["refused"], what=following.log_text)
        assert any("parallelism" in problem for problem in configz(following)["refused"])
        assert any('unknown field "typo"' in problem for problem in configz(following)["refused"])
        stage.create_pod(pod("one"))
        stage.wait_bound("one")
        settings.give(document(leaderElection={**ELECTION, "leaseDuration": "20s"}))
        stage.wait(lambda: "leaderElection" in configz(following)["refused"][0], what=following.log_text)
        stage.create_pod(pod("two"))
        stage.wait_bound("two")
        assert configz(following)["digest"] == digest
        assert settings.kept() == document(), "what was never in use is not the last good one"
        stage.wait(lambda: {"ConfigInvalid", "ConfigRestartNeeded"} <= set(settings.told()), what=settings.told)
        settings.give(document())
        stage.wait(lambda: not configz(following)["refused"], what=following.log_text)


def test_a_restart_with_a_bad_configuration_goes_on_with_the_last_good_one(
    installed_plane: ControlPlane, stage: Stage, settings: Settings, following: Process
) -> None:
    digest = configz(following)["digest"]
    following.stop()
    settings.give("nonsense: [")
    following.start().wait_ready()
    assert configz(following)["digest"] == digest
    assert "strict decoding error" in configz(following)["refused"][0]
    with nodes(installed_plane, edge("edge-1")):
        stage.create_pod(pod("still"))
        stage.wait_bound("still")


def test_a_plugin_put_into_the_shadow_is_scored_recorded_and_counted_and_decides_no_more(
    installed_plane: ControlPlane, stage: Stage, settings: Settings, following: Process
) -> None:
    shadow = [{"name": "NodeResourcesFit", "args": {"shadow": True}}]
    digest = configz(following)["digest"]
    settings.give(document(profiles=[{"schedulerName": "ros-aware-scheduler", "pluginConfig": shadow}]))
    stage.wait(lambda: configz(following)["digest"] != digest, what=following.log_text)
    with nodes(installed_plane, edge("shade-1", cpu="1"), edge("shade-2", cpu="64")):
        stage.create_pod(pod("shaded", requests={"cpu": "32"}))
        assert stage.wait_bound("shaded"), "even where it does not fit: its filter is a shadow, too"
        record = get(following, f"/explain/{stage.namespace}/shaded")
        assert record["top"]["shadow"] == ["NodeResourcesFit"]
        counted = 'extension_point="shadow",plugin="NodeResourcesFit"'
        with urllib.request.urlopen(f"{following.health_url}/metrics", context=unverified()) as answer:  # noqa: S310 - our own
            assert f"scheduler_plugin_decisions_total{{{counted}" in answer.read().decode()
        stage.delete_pod("shaded")
