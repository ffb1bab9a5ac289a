"""Components without ROS: pods without domain and discovery, in apps with ROS components beside them and in apps without any."""

from typing import Any, Final

import pytest
from tests.support.factories import component, make_app

from robotapp_claims.rules.release import claims_domain
from robotapp_operator.plan.diff.diff import wanted_children
from robotapp_operator.plan.render.child import DEPLOYMENT, Child
from robotapp_operator.plan.spec.desired import App, Domain, desired_of
from robotapp_operator.watch.lister import needs_domain
from robotapp_operator.watch.sharing_index import rules_view

OURS: Final = ["ROBOTAPP_APP", "ROBOTAPP_INSTANCE", "ROBOTAPP_ROBOT", "ROBOTAPP_COMPONENT"]


def children_of(app: App) -> dict[str, Child]:
    """Deployments of components by name, those of helpers by role."""
    domain = Domain(7, "dds.default.c.7") if needs_domain(app) else None
    children = wanted_children(desired_of(app, ""), domain=domain, parameters={}, running=True)
    return {child.labels["app.kubernetes.io/name"]: child for child in children if child.ref.kind == DEPLOYMENT}


def pod_of(child: Child) -> dict[str, Any]:
    spec: dict[str, Any] = child.spec["template"]["spec"]
    return spec


def variables_of(child: Child) -> list[str]:
    return [variable["name"] for variable in pod_of(child)["containers"][0]["env"]]


def test_a_component_without_ros_has_the_variables_of_the_app_alone_and_waits_for_no_names() -> None:
    found = children_of(make_app(component("a"), component("b"), component("store", ros="None")))
    assert variables_of(found["store"]) == OURS
    assert "initContainers" not in pod_of(found["store"])
    assert "annotations" not in found["store"].spec["template"]["metadata"]
    assert "ROS_DOMAIN_ID" in variables_of(found["a"])
    assert "discovery" in found


def test_the_peers_of_cyclone_are_those_with_ros() -> None:
    app = make_app(component("a"), component("b"), component("store", ros="None"), ros2={"rmw": "rmw_cyclonedds_cpp"})
    found = children_of(app)
    assert [name.partition(".")[0] for name in desired_of(app, "").peer_names] == ["a", "b"]
    assert "hostname" not in pod_of(found["store"])


def test_one_component_with_ros_beside_others_without_needs_no_discovery_server() -> None:
    app = make_app(component("a"), component("store", ros="None"))
    assert desired_of(app, "").discovery == "None"
    assert children_of(app).keys() == {"a", "store"}


def test_one_component_that_shares_its_domain_with_other_apps_stays_within_its_pod_and_needs_no_server() -> None:
    app = make_app(component("a"), ros2={"isolation": "Discovery"})
    assert desired_of(app, "").discovery == "Localhost"
    assert children_of(app).keys() == {"a"}


@pytest.mark.parametrize(
    "app",
    [
        make_app(component("store", ros="None"), component("web", ros="None")),
        make_app(component("store"), component("web"), ros={"distro": "none"}),
        make_app(component("store", ros="None"), component("web", ros="None"), ros={"distro": "noetic"}),
    ],
    ids=["components", "app", "ROS 1"],
)
def test_an_app_without_ros_takes_no_domain_and_has_no_helpers(app: App) -> None:
    found = children_of(app)
    assert not needs_domain(app)
    assert not claims_domain(rules_view(app))
    assert found.keys() == {"store", "web"}
    assert variables_of(found["web"]) == OURS
    assert (desired_of(app, "").rmw, desired_of(app, "").discovery) == ("", "")


def test_helpers_follow_the_components_with_ros() -> None:
    """A database that tolerates nothing and has an account of its own does not keep the servers off the robots' nodes."""
    robot = {"spec": {"tolerations": [{"key": "a", "operator": "Exists"}], "serviceAccountName": "robot"}}
    found = children_of(
        make_app(component("store", ros="None"), component("a", template=robot), component("b", template=robot))
    )
    assert pod_of(found["discovery"])["serviceAccountName"] == "robot"
    assert {"key": "a", "operator": "Exists"} in pod_of(found["discovery"])["tolerations"]


def test_a_router_runs_the_image_of_the_first_component_with_ros() -> None:
    app = make_app(component("store", ros="None"), component("a"), component("b"), ros2={"rmw": "rmw_zenoh_cpp"})
    assert pod_of(children_of(app)["router"])["containers"][0]["image"] == "reg/a:1"


def test_a_suspended_component_has_no_pods_and_leaves_the_others_as_they_are() -> None:
    running = children_of(make_app(component("a"), component("b")))
    found = children_of(make_app(component("a"), component("b", replicas=0)))
    assert found["b"].spec["replicas"] == 0
    assert found["b"].spec["strategy"] == running["b"].spec["strategy"]
    assert {name: child.hash for name, child in found.items() if name != "b"} == {
        name: child.hash for name, child in running.items() if name != "b"
    }


def test_helpers_stop_while_every_component_with_ros_is_suspended() -> None:
    found = children_of(make_app(component("a", replicas=0), component("b", replicas=0), component("web", ros="None")))
    assert [found[name].spec["replicas"] for name in ("a", "b", "discovery", "web")] == [0, 0, 0, 1]
