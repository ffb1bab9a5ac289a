"""Each of the ten ROS plugins decides about an app as the operator renders it, and without that plugin the app fares otherwise."""

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest
import yaml
from tests.live.scheduling.ros import rendered_ros_cases as cases
from tests.support.seeds import choose_for_today

from campaigns.rigs.live import eventually
from campaigns.rigs.simulated_site import SimulatedSite
from robotapp_api.model.names import Annotation, Label
from robotapp_scheduler.plugins.registry import ROS
from robotapp_testbed import ControlPlane, Process
from robotapp_testbed.control_plane import product

pytestmark = pytest.mark.live

Json = dict[str, Any]
MARK = "without-"


class Played:
    """A world whose scheduler is started when all that it is to decide about waits for it."""

    def __init__(self, world: SimulatedSite, folder: Path) -> None:
        self.world = world
        self._folder = folder
        self._scheduler: Process = world.scheduler
        self.shipped: Mapping[str, str] = {}
        """What the shipped configuration did, by plugin."""

    def decide(self, apps: Sequence[Json], *, without: Sequence[str] = ()) -> None:
        """Apply the apps in their order, and start the scheduler when the operator has made their pods."""
        self._scheduler.kill()  # it gives nothing back at its end: the other ones are not elected either
        for app in apps:
            self.world.create(app)
        wanted = {(app["metadata"]["name"], part["name"]) for app in apps for part in app["spec"]["components"]}
        eventually(lambda: wanted <= self._pods().keys(), what=lambda: wanted - self._pods().keys())
        config = self._folder / "scheduler.yaml"
        config.write_text(yaml.safe_dump(cases.document(*without)))
        name = "-".join(["scheduler", *(plugin.lower() for plugin in without)])
        self._scheduler = product.start_scheduler(self.world.cp, config, name=name, sweep_seconds=1, log_format="text")

    def stop(self) -> None:
        self._scheduler.stop()

    def forget(self, apps: Sequence[Json]) -> None:
        """Delete these apps, and wait until their pods are gone."""
        names = {app["metadata"]["name"] for app in apps}
        self.world.delete(*names)
        eventually(lambda: names.isdisjoint(app for app, _ in self._pods()), what=self._pods)

    def decided(self, *apps: str) -> Json:
        """The planner's pod of the first of these apps that was placed, or cannot be with this configuration."""
        return eventually(lambda: self._decided(apps), what=lambda: json.dumps(list(self._pods().values())))

    def _decided(self, apps: Sequence[str]) -> Json:
        pods = self._pods()
        found = (pods.get((app, cases.PLANNER), {}) for app in apps)
        return next((pod for pod in found if pod and (pod["spec"].get("nodeName") or refusal(pod))), {})

    def _pods(self) -> Mapping[tuple[str, str], Json]:
        """By app and component. The operator's own, such as discovery servers, have no component."""
        found = {}
        for pod in self.world.pods():
            labels = pod["metadata"].get("labels", {})
            if Label.COMPONENT in labels:
                found[labels[Label.APP], labels[Label.COMPONENT]] = pod
        return found


@pytest.fixture(scope="module")
def played(installed_plane: ControlPlane, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Played]:
    """All apps at once, under the shipped configuration."""
    with SimulatedSite(installed_plane, cases.world(), pools={cases.POOL: "1-40"}) as world:
        found = Played(world, tmp_path_factory.mktemp("rendered"))
        pods = f"/api/v1/namespaces/{world.namespace}/pods"
        for pod in cases.loads():
            installed_plane.api.create(pods, pod)
        objectives = map(cases.for_objective, cases.OBJECTIVES)
        found.decide([*(app for plugin in cases.PLUGINS for app in cases.apps_of(plugin)), *objectives])
        found.shipped = {plugin: outcome(found, plugin) for plugin in cases.PLUGINS}
        yield found
        found.stop()
        for pod in cases.loads():
            installed_plane.api.delete(f"{pods}/{pod['metadata']['name']}?gracePeriodSeconds=0")


def outcome(played: Played, plugin: str, *, mark: str = "") -> str:
    """What is seen of the plugin's apps."""
    pod = played.decided(*(app["metadata"]["name"] for app in cases.apps_of(plugin, mark=mark)))
    if plugin == cases.QUEUE:
        return str(pod["metadata"]["labels"][Label.APP]).removeprefix(mark)
    if plugin in cases.WISHES:
        return str(pod["spec"]["nodeName"])
    if message := refusal(pod):
        return message.rpartition(": ")[2].partition(" in the scheduler's configuration")[0]
    assert pod["spec"]["nodeName"] == cases.ROBOT, "by affinity and toleration that the operator renders"
    grant = str(pod["metadata"].get("annotations", {}).get(Annotation.GRANTED_DEVICES, ""))
    held = [claim["spec"]["device"]["id"] for claim in played.world.claims() if "device" in claim["spec"]]
    assert grant in ("", *held), "the claim comes first"
    return f"granted {grant}" if grant else "bound"


def refusal(pod: Json) -> str:
    """Why the pod was not placed, in words about the scheduler's configuration; "" otherwise."""
    found = [item for item in pod["status"].get("conditions", ()) if item["type"] == "PodScheduled"]
    message = str(found[0].get("message", "")) if found else ""
    return message if "configuration" in message else ""


def test_every_ros_plugin_is_played() -> None:
    names = {ref.name for ref in ROS} - {"AllowedNamespaces"}  # ours, and tested in a module of its own
    assert len(names) == 10
    assert set(cases.PLUGINS) == names


@pytest.mark.parametrize("plugin", cases.PLUGINS)
def test_the_plugin_acts_on_an_app_that_the_operator_rendered(played: Played, plugin: str) -> None:
    expected, _ = cases.outcomes(plugin)
    assert played.shipped[plugin] == expected


@pytest.mark.parametrize("plugin", choose_for_today(cases.PLUGINS))
def test_without_the_plugin_the_same_app_fares_otherwise(played: Played, plugin: str) -> None:
    """So it was this plugin. Without the two that check and hand over domains and devices, no app is placed at all."""
    _, expected = cases.outcomes(plugin)
    if plugin == cases.QUEUE:
        played.forget(cases.apps_of(plugin))  # there is room for one
    played.decide(cases.apps_of(plugin, mark=MARK), without=[plugin])
    assert outcome(played, plugin, mark=MARK) == expected


@pytest.mark.parametrize("objective", sorted(cases.OBJECTIVES))
def test_the_objective_decides_between_the_nearest_node_and_the_emptiest(played: Played, objective: str) -> None:
    pod = played.decided(cases.for_objective(objective)["metadata"]["name"])
    assert pod["spec"]["nodeName"] == cases.OBJECTIVES[objective]
