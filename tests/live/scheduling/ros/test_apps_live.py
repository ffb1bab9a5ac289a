"""Pods of a RobotApp: placed together, never beside their predecessor, never without their domain's claim."""

import pytest
from tests.support.apiobjects import component

from campaigns.rigs.stage import CLAIMS, Json, Stage, deployment, nodes, pod
from robotapp_api.model.names import API_VERSION, Label
from robotapp_testbed import ControlPlane
from robotapp_testbed.machines.nodes import edge

pytestmark = [pytest.mark.live, pytest.mark.usefixtures("scheduler")]


def component_pods(stage: Stage, name: str) -> list[Json]:
    return stage.pods(**{str(Label.COMPONENT): name})


def node_of(stage: Stage, name: str) -> str:
    return next((item["spec"].get("nodeName", "") for item in component_pods(stage, name)), "")


def wait_placed(stage: Stage, *names: str) -> None:
    for name in names:
        stage.wait(lambda name=name: node_of(stage, name), what=lambda name=name: f"{name} is not placed")


def test_an_app_waits_until_all_its_components_have_pods(installed_plane: ControlPlane, stage: Stage) -> None:
    with nodes(installed_plane, edge("edge-1")):
        app = stage.create_app("teleop", [component("operator"), component("driver")])
        stage.create_deployment(deployment(app, "driver"))
        stage.wait(lambda: component_pods(stage, "driver"), what=lambda: "no pod")
        stage.create_pod(pod("later"))  # decided after the driver's pod was seen
        stage.wait_bound("later")
        assert node_of(stage, "driver") == ""
        stage.create_deployment(deployment(app, "operator"))
        wait_placed(stage, "driver", "operator")


def test_a_component_that_is_named_in_colocate_with_does_not_start_apart_when_its_node_is_cordoned(
    installed_plane: ControlPlane, stage: Stage
) -> None:
    """The rule held from the declaring side alone: cordon, delete the other pod, and both ran apart."""
    with nodes(installed_plane, edge("pair-1"), edge("pair-2")):
        app = stage.create_app("pair", [component("camera", colocateWith=["driver"]), component("driver")])
        for name in ("camera", "driver"):
            stage.create_deployment(deployment(app, name))
        wait_placed(stage, "camera", "driver")
        home = node_of(stage, "camera")
        assert node_of(stage, "driver") == home
        installed_plane.api.patch(f"/api/v1/nodes/{home}", {"spec": {"unschedulable": True}})
        (old,) = component_pods(stage, "driver")
        stage.delete_pod(old["metadata"]["name"])

        def successor() -> str:
            names = {item["metadata"]["name"] for item in component_pods(stage, "driver")}
            return next(iter(names - {old["metadata"]["name"]}), "")

        name = stage.wait(successor, what=lambda: "no successor")
        stage.wait_refused(name, reason="Unschedulable", saying="must share its node with")
        installed_plane.api.patch(f"/api/v1/nodes/{home}", {"spec": {"unschedulable": False}})
        assert stage.wait_bound(name) == home


def test_a_pod_that_only_wears_the_labels_of_an_app_is_not_bound(installed_plane: ControlPlane, stage: Stage) -> None:
    with nodes(installed_plane, edge("edge-1")):
        app = stage.create_app("teleop", [component("driver")])
        labels = {str(Label.APP_UID): app["metadata"]["uid"], str(Label.COMPONENT): "driver", str(Label.INSTANCE): ""}
        stage.create_pod(pod("impostor", labels=labels))
        stage.create_pod(pod("later"))
        stage.wait_bound("later")
        assert stage.node_of("impostor") == ""


def test_a_single_replica_component_waits_for_its_predecessor_to_end(
    installed_plane: ControlPlane, stage: Stage
) -> None:
    with nodes(installed_plane, edge("edge-1")):
        app = stage.create_app("teleop", [component("driver")])
        stage.create_deployment(deployment(app, "driver"))
        wait_placed(stage, "driver")
        (old,) = component_pods(stage, "driver")
        path = f"{stage.pods_path}/{old['metadata']['name']}"
        installed_plane.api.patch(path, {"metadata": {"finalizers": ["test.robotics.io/hold"]}})
        installed_plane.api.delete(path)
        stage.wait(lambda: len(component_pods(stage, "driver")) == 2, what=lambda: "no successor")
        (new,) = [item for item in component_pods(stage, "driver") if item["metadata"]["uid"] != old["metadata"]["uid"]]
        stage.create_pod(pod("later"))
        stage.wait_bound("later")
        assert stage.node_of(new["metadata"]["name"]) == ""
        installed_plane.api.patch(path, {"metadata": {"finalizers": None}})
        stage.wait_bound(new["metadata"]["name"])


class Domain:
    """The claim of domain 42 for an app, as the operator would make it."""

    PATH = f"{CLAIMS}/dds.default.c.42"

    def __init__(self, cp: ControlPlane, app: Json) -> None:
        self._api = cp.api
        self._app = app["metadata"]

    def create(self, **holder: str) -> None:
        meta = self._app
        spec = {
            "domain": {"pool": "default", "scope": "Cluster", "scopeValue": "", "id": 42},
            "holder": {
                "apiVersion": API_VERSION,
                "kind": "RobotApp",
                "namespace": meta["namespace"],
                "name": meta["name"],
                "uid": meta["uid"],
                "instance": "",
                "component": "",
                **holder,
            },
        }
        metadata = {"name": "dds.default.c.42", "labels": {str(Label.CLAIM): "dds"}}
        self._api.create(CLAIMS, {"apiVersion": API_VERSION, "kind": "RobotClaim", "metadata": metadata, "spec": spec})

    def delete(self) -> None:
        self._api.delete(self.PATH)


def carrier(stage: Stage, app: Json) -> None:
    """A Deployment whose pods carry domain 42 in their environment."""
    container = {"name": "main", "image": "registry.invalid/main:1", "env": [{"name": "ROS_DOMAIN_ID", "value": "42"}]}
    stage.create_deployment(deployment(app, "driver", containers=[container]))


def refused_driver(stage: Stage) -> str:
    """The text of the one driver pod that waits for its domain."""
    stage.wait(lambda: component_pods(stage, "driver"), what=lambda: "no pod")
    (found,) = component_pods(stage, "driver")
    return stage.wait_refused(found["metadata"]["name"], reason="WaitingForDomain")


def test_a_pod_is_not_bound_before_its_domain_is_claimed_and_at_once_afterwards(
    installed_plane: ControlPlane, stage: Stage
) -> None:
    with nodes(installed_plane, edge("edge-1")):
        app = stage.create_app("teleop", [component("driver")])
        carrier(stage, app)
        assert "domain 42 is not claimed for this app yet" in refused_driver(stage)
        claim = Domain(installed_plane, app)
        claim.create()
        try:
            wait_placed(stage, "driver")
        finally:
            claim.delete()


def test_a_claim_of_another_app_or_instance_does_not_count(installed_plane: ControlPlane, stage: Stage) -> None:
    with nodes(installed_plane, edge("edge-1")):
        app = stage.create_app("teleop", [component("driver")])
        claim = Domain(installed_plane, app)
        claim.create(instance="amr-08")
        try:
            carrier(stage, app)
            assert "domain 42" in refused_driver(stage)
            assert node_of(stage, "driver") == ""
        finally:
            claim.delete()
