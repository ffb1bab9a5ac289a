"""Which components of an app have pods: one that waits for others, one that is suspended, and those without ROS."""

from typing import Any

import pytest

from campaigns.rigs.live import HandBinder, Tenant, eventually, part
from robotapp_api.model.names import Label
from robotapp_testbed import ControlPlane

pytestmark = pytest.mark.usefixtures("operator")


@pytest.fixture
def alone(installed_plane: ControlPlane, namespace: str) -> Tenant:
    """A namespace in which nobody binds pods."""
    return Tenant(installed_plane, namespace)


def mapping(**driver: Any) -> list[dict[str, Any]]:
    return [part("mapper", dependsOn=[{"component": "driver"}]), part("driver", **driver)]


def pods_of(tenant: Tenant, component: str) -> list[str]:
    """Uids of pods that are not about to end."""
    return [
        pod["metadata"]["uid"]
        for pod in tenant.listed("pods")
        if pod["metadata"]["labels"].get(Label.COMPONENT) == component and "deletionTimestamp" not in pod["metadata"]
    ]


def message_of(tenant: Tenant, name: str, kind: str = "Ready") -> str:
    return str(tenant.condition(name, kind)["message"])


def test_a_component_is_created_when_the_one_it_depends_on_is_ready_and_says_so_meanwhile(
    alone: Tenant, ids: str
) -> None:
    alone.apply("map", *mapping(), ros2={"pool": ids})
    eventually(lambda: pods_of(alone, "driver"), what=alone.children)
    eventually(lambda: [item for item in alone.instances("map") if "components" in item.get("status", {})])
    shown = {item["name"]: item.get("message", "") for item in alone.instances("map")[0]["status"]["components"]}
    assert shown["mapper"] == "waits until driver is Ready (dependsOn)"
    assert alone.deployments("mapper") == []
    with HandBinder(alone.cp, alone.namespace):
        alone.wait_ready("map")
    assert [item["spec"]["replicas"] for item in alone.deployments("mapper")] == [1]


def test_what_runs_is_not_stopped_when_its_dependency_restarts_and_what_was_stopped_starts_in_order(
    alone: Tenant, ids: str
) -> None:
    with HandBinder(alone.cp, alone.namespace):
        alone.apply("map", *mapping(), ros2={"pool": ids})
        alone.wait_ready("map")
    (mapper,) = pods_of(alone, "mapper")
    alone.edit("map", components=mapping(image="reg/driver:2"))
    alone.wait("map", "Ready", "False")
    assert pods_of(alone, "mapper") == [mapper]
    with HandBinder(alone.cp, alone.namespace):
        alone.wait_ready("map")
        assert pods_of(alone, "mapper") == [mapper]
        alone.edit("map", suspend=True)
        eventually(lambda: not alone.listed("pods"), what=alone.children)
    alone.edit("map", suspend=False)
    eventually(lambda: pods_of(alone, "driver"), what=alone.children)
    assert pods_of(alone, "mapper") == []
    with HandBinder(alone.cp, alone.namespace):
        alone.wait_ready("map")


def test_a_suspended_component_has_no_pod_is_not_wanted_and_does_not_disturb_the_others(
    tenant: Tenant, ids: str
) -> None:
    parts = (part("driver"), part("logger"))
    tenant.apply("work", *parts, ros2={"pool": ids})
    tenant.wait_ready("work")
    (driver,) = pods_of(tenant, "driver")
    tenant.edit("work", components=[parts[0], {**parts[1], "replicas": 0}])
    eventually(lambda: not pods_of(tenant, "logger"), what=tenant.children)
    assert tenant.wait_ready("work")["status"]["summary"]["ready"] == "1/1"
    assert pods_of(tenant, "driver") == [driver]
    tenant.edit("work", components=parts)
    eventually(lambda: pods_of(tenant, "logger"), what=tenant.children)
    assert tenant.wait_ready("work")["status"]["summary"]["ready"] == "2/2"
    assert pods_of(tenant, "driver") == [driver]
    tenant.edit("work", components=[{**each, "replicas": 0} for each in parts])
    tenant.wait("work", "Ready", "False", reason="Suspended")
    eventually(lambda: tenant.app("work")["status"]["phase"] == "Suspended", what=lambda: tenant.app("work"))
    assert len(tenant.claims()) == 1, "the domain is kept"


def test_an_app_without_ros_has_pods_and_nothing_else(tenant: Tenant) -> None:
    tenant.apply("site", part("store"), part("web", dependsOn=[{"component": "store"}]), ros={"distro": "none"})
    app = tenant.wait_ready("site")
    assert tenant.claims() == []
    assert tenant.listed("services") == []
    assert len(tenant.listed("apps/deployments")) == 2
    assert {"domain", "rmw", "discovery"} & app["status"]["summary"].keys() == set()
    names = {item["name"] for pod in tenant.listed("pods") for item in pod["spec"]["containers"][0]["env"]}
    assert not {name for name in names if name.startswith(("ROS_", "RMW_"))}


def test_a_component_without_ros_beside_one_with_it_needs_no_discovery_server_and_a_second_one_does(
    tenant: Tenant, ids: str
) -> None:
    store = part("store", ros="None")
    tenant.apply("mixed", part("driver"), store, ros2={"pool": ids})
    tenant.wait_ready("mixed")
    assert len(tenant.claims()) == 1
    assert len(tenant.listed("apps/deployments")) == 2
    (kept,) = pods_of(tenant, "store")
    tenant.edit("mixed", components=[part("driver"), store, part("planner")])
    eventually(lambda: len(tenant.listed("apps/deployments")) == 5, what=tenant.children)
    tenant.wait_ready("mixed")
    assert pods_of(tenant, "store") == [kept]


def test_an_app_that_gives_up_ros_gives_its_domain_back(tenant: Tenant, ids: str) -> None:
    tenant.apply("site", part("store"), ros2={"pool": ids})
    tenant.wait_ready("site")
    assert len(tenant.claims()) == 1
    tenant.edit("site", components=[part("store", ros="None")])
    eventually(lambda: not tenant.claims(), timeout_s=90, what=tenant.claims)
    tenant.wait_ready("site")


def test_a_circle_of_dependencies_is_refused_with_its_names(tenant: Tenant) -> None:
    waits = {name: [{"component": other}] for name, other in (("a", "b"), ("b", "a"))}
    tenant.apply("circle", *(part(name, dependsOn=waits[name]) for name in waits))
    tenant.wait("circle", "Accepted", "False", reason="InvalidSpec")
    assert "a waits for b waits for a, so none of them would ever be created" in message_of(
        tenant, "circle", "Accepted"
    )
    assert tenant.deployments() == []
