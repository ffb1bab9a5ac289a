"""Services that components ask for: made, changed and removed with the app, and shown as addresses."""

from typing import Any

import pytest

from campaigns.rigs.live import Tenant, eventually, part

pytestmark = pytest.mark.usefixtures("operator")

SERVICES = "/api/v1/namespaces/{}/services"


def bridge(*, annotations: dict[str, str] | None = None, **spec: Any) -> dict[str, Any]:
    service = {
        "metadata": {"annotations": annotations or {}},
        "spec": {"ports": [{"name": "http", "port": 80, "targetPort": 8080}], **spec},
        "links": [{"name": "ui", "port": "http", "path": "/map"}],
    }
    return part("bridge", service=service)


def services(tenant: Tenant) -> list[dict[str, Any]]:
    """The Services of the component, not those of discovery."""
    path = f"{SERVICES.format(tenant.namespace)}?labelSelector=robotics.io/component%3Dbridge"
    items: list[dict[str, Any]] = tenant.cp.api.get(path)["items"]
    return items


def links(tenant: Tenant) -> list[dict[str, Any]]:
    (instance,) = tenant.instances("teleop")
    addresses: list[dict[str, Any]] = instance["status"].get("links", [])
    return addresses


def test_a_service_and_its_address_follow_the_spec_and_end_with_it(tenant: Tenant, ids: str) -> None:
    tenant.apply("teleop", bridge(), part("driver"), ros2={"pool": ids})
    tenant.wait_ready("teleop")
    (service,) = services(tenant)
    name = service["metadata"]["name"]
    inside = {"component": "bridge", "name": "ui", "url": f"http://{name}.{tenant.namespace}.svc:80/map"}
    eventually(lambda: links(tenant) == [inside], what=lambda: links(tenant))

    tenant.edit("teleop", components=[bridge(type="NodePort", annotations={"example.com/a": "b"}), part("driver")])
    changed = eventually(
        lambda: next((item for item in services(tenant) if item["spec"]["type"] == "NodePort"), None),
        what=lambda: services(tenant),
    )
    assert changed is not None
    assert changed["metadata"]["name"] == name, "the name stays"
    assert changed["metadata"]["annotations"]["example.com/a"] == "b"
    port = changed["spec"]["ports"][0]["nodePort"]
    eventually(
        lambda: (
            [link["url"].endswith(f":{port}/map") and ".svc" not in link["url"] for link in links(tenant)] == [True]
        ),
        what=lambda: links(tenant),
    )

    tenant.edit("teleop", components=[bridge(), part("driver")])
    eventually(
        lambda: [item["metadata"]["annotations"].get("example.com/a") for item in services(tenant)] == [None],
        what=lambda: services(tenant),
    )
    tenant.edit("teleop", suspend=True)
    tenant.wait("teleop", "Ready", "False", reason="Suspended")
    assert [item["metadata"]["name"] for item in services(tenant)] == [name], "a suspended app keeps its addresses"

    tenant.edit("teleop", suspend=False, components=[part("bridge"), part("driver")])
    eventually(lambda: not services(tenant) and not links(tenant), what=lambda: (services(tenant), links(tenant)))


def test_a_load_balancers_address_is_shown_when_there_is_one(tenant: Tenant, ids: str) -> None:
    tenant.apply("teleop", bridge(type="LoadBalancer"), ros2={"pool": ids})
    tenant.wait_ready("teleop")
    (service,) = services(tenant)
    assert links(tenant) == []
    path = f"{SERVICES.format(tenant.namespace)}/{service['metadata']['name']}/status"
    tenant.cp.api.patch(path, {"status": {"loadBalancer": {"ingress": [{"ip": "203.0.113.9"}]}}})
    eventually(
        lambda: [link["url"] for link in links(tenant)] == ["http://203.0.113.9:80/map"], what=lambda: links(tenant)
    )
