"""Services that components ask for, and the addresses that links stand for."""

from typing import Any

import pytest
from tests.support.factories import component, make_app

from robotapp_api.checks.spec import spec_problems
from robotapp_claims.rules.objects import OwnerReference
from robotapp_operator.plan.diff.diff import wanted_children
from robotapp_operator.plan.render.child import DEPLOYMENT, SERVICE, Child
from robotapp_operator.plan.render.services import component_services
from robotapp_operator.plan.spec.desired import App, Domain, desired_of
from robotapp_operator.plan.spec.links import LinkView, list_links
from robotapp_operator.plan.spec.objects import (
    GivenPort,
    Ingress,
    LoadBalancerStatus,
    Service,
    ServiceStatus,
    TenantMeta,
)

Json = dict[str, Any]
HTTP = {"name": "http", "port": 80, "targetPort": 8080}


def app_with(links: list[Json], *, ports: tuple[Json, ...] = (HTTP,), **spec: Any) -> App:
    service = {"spec": {"ports": list(ports), **spec}, "links": links}
    return make_app(component("operator"), component("map", service=service))


def render(app: App, robot: str = "amr-07") -> Child:
    (service,) = component_services(desired_of(app, robot))
    return service


def stored(app: App, *, ports: list[Json] | None = None, ingress: list[Ingress] | None = None) -> dict[str, Service]:
    """The Service as the API server stores it."""
    child = render(app)
    labels = {"robotics.io/app-uid": app.uid}
    owner = OwnerReference(kind="RobotApp", name=app.name, uid=app.uid, controller=True)
    metadata = TenantMeta(name=child.ref.name, namespace="default", labels=labels, owner_references=(owner,))
    status = ServiceStatus(LoadBalancerStatus(ingress or []))
    given = {"type": child.spec["type"], "ports": ports or child.spec["ports"]}
    service = Service(metadata=metadata, given=given, status=status)  # type: ignore[arg-type]
    return {child.ref.name: service}


def links_of(app: App, *, node: str = "192.0.2.7", **given: Any) -> tuple[LinkView, ...]:
    addresses = {"amr-07": node}
    services = stored(app, **given)
    return list_links(desired_of(app, "amr-07"), services, {"map": "amr-07"}, lambda name: addresses.get(name, ""))


def test_a_service_selects_the_components_pods_of_its_instance() -> None:
    app = app_with([])
    service = render(app)
    children = wanted_children(desired_of(app, "amr-07"), domain=Domain(7), parameters={}, running=True)
    assert service.ref in {child.ref for child in children}
    pods = {
        child.component: child.spec["template"]["metadata"]["labels"]
        for child in children
        if child.ref.kind == DEPLOYMENT and child.component
    }
    assert service.spec["selector"].items() <= pods["map"].items()
    assert not service.spec["selector"].items() <= pods["operator"].items()
    assert service.spec["ports"] == [{"name": "http", "port": 80, "protocol": "TCP", "targetPort": 8080}]


def test_each_instance_has_a_name_of_its_own_that_stays() -> None:
    app = app_with([])
    assert render(app, "amr-07").ref.name != render(app, "amr-08").ref.name
    assert render(app).ref == render(app_with([], type="NodePort")).ref


def test_a_suspended_app_keeps_its_services() -> None:
    desired = desired_of(app_with([]), "")
    children = wanted_children(desired, domain=Domain(7), parameters={}, running=False)
    assert [child.component for child in children if child.ref.kind == SERVICE and child.component] == ["map"]


def test_an_app_without_services_has_the_children_it_had() -> None:
    assert component_services(desired_of(make_app(), "amr-07")) == []


def test_annotations_are_part_of_what_is_compared() -> None:
    def annotated(value: str) -> Child:
        service = {"metadata": {"annotations": {"example.com/pool": value}}, "spec": {"ports": [HTTP]}}
        return render(make_app(component("map", service=service)))

    assert annotated("a").annotations == {"example.com/pool": "a"}
    assert annotated("a").hash != annotated("b").hash


def test_labels_of_a_service_have_the_name_of_the_robot_as_those_of_pods_have() -> None:
    """The schema lets the reference through, and the API server would refuse a Service with it as it stands."""
    service = {"metadata": {"labels": {"site": "yard-$(ROBOTAPP_ROBOT)"}}, "spec": {"ports": [HTTP]}}
    robots = {"nodeSelector": {"matchLabels": {"robotics.io/robot": "amr-07"}}}
    assert render(make_app(component("map", service=service), robots=robots)).labels["site"] == "yard-amr-07"
    (problem,) = spec_problems(make_app(component("map", service=service)).spec)
    assert problem.field == 'spec.components[0].service.metadata.labels["site"]'
    assert "the app has none" in problem.message


@pytest.mark.parametrize("field", ["labels", "annotations"])
def test_a_key_of_a_service_that_the_api_server_refuses_is_named_before(field: str) -> None:
    service = {"metadata": {field: {"a" * 64: "x"}}, "spec": {"ports": [HTTP]}}
    (problem,) = spec_problems(make_app(component("map", service=service)).spec)
    assert problem.field == f"spec.components[0].service.metadata.{field}"


def test_a_port_by_name_leads_to_a_port_of_the_pods_containers_or_is_refused() -> None:
    named = {"name": "http", "port": 80, "targetPort": "web"}
    web = [{"name": "web", "containerPort": 8080}]
    fields = {"service": {"spec": {"ports": [named]}}}
    beside = {"spec": {"containers": [{"name": "nginx", "image": "nginx", "ports": web}]}}
    assert not [*spec_problems(make_app(component("map", ports=web, **fields)).spec)]
    assert not [*spec_problems(make_app(component("map", template=beside, **fields)).spec)]
    (problem,) = spec_problems(make_app(component("map", **fields)).spec)
    assert str(problem).startswith(
        "spec.components[0].service.spec.ports[0].targetPort: no container of map has a TCP port named web"
    )
    udp = [{"name": "web", "containerPort": 8080, "protocol": "UDP"}]
    assert [*spec_problems(make_app(component("map", ports=udp, **fields)).spec)]


def test_a_link_of_the_cluster_has_the_services_name() -> None:
    app = app_with([{"name": "ui", "port": "http", "path": "/vnc.html"}])
    name = render(app).ref.name
    assert links_of(app) == (LinkView("map", "ui", f"http://{name}.default.svc:80/vnc.html"),)


def test_a_link_of_a_node_port_has_the_address_of_the_node_and_the_port_that_the_cluster_chose() -> None:
    app = app_with([{"name": "ui", "port": "http"}], type="NodePort")
    ports = [{"name": "http", "port": 80, "nodePort": 30080}]
    assert links_of(app, ports=ports)[0].url == "http://192.0.2.7:30080"
    assert links_of(app, ports=ports, node="2001:db8::7")[0].url == "http://[2001:db8::7]:30080"
    assert links_of(app, ports=ports, node="") == (), "a component that waits for a node has no address"


def test_a_link_of_a_load_balancer_waits_for_its_address() -> None:
    app = app_with([{"name": "ui", "port": "http", "scheme": "https"}], type="LoadBalancer")
    assert links_of(app) == ()
    assert links_of(app, ingress=[Ingress(ip="203.0.113.9")])[0].url == "https://203.0.113.9:80"
    assert links_of(app, ingress=[Ingress(hostname="lb.example.com")])[0].url == "https://lb.example.com:80"


def test_the_ports_of_a_stored_service_are_read() -> None:
    (service,) = stored(
        app_with([]), ports=[{"name": "http", "port": 80, "nodePort": 30080, "protocol": "TCP"}]
    ).values()
    assert service.ports == [GivenPort(name="http", port=80, node_port=30080)]


def test_each_discovery_server_has_an_entrance_of_its_own_for_programs_outside() -> None:
    """A client must reach both; behind one Service it would reach one of them."""
    app = make_app(ros2={"external": {"expose": "NodePort"}})
    children = wanted_children(desired_of(app, "amr-07"), domain=Domain(7), parameters={}, running=True)
    entrances = [child for child in children if child.ref.kind == SERVICE and child.spec.get("type") == "NodePort"]
    assert [child.spec["ports"][0]["port"] for child in entrances] == [11811, 11811]
    servers = [
        child.spec["template"]["metadata"]["labels"]
        for child in children
        if child.ref.kind == DEPLOYMENT and child.labels.get("robotics.io/part")
    ]
    for entrance in entrances:
        assert sum(entrance.spec["selector"].items() <= labels.items() for labels in servers) == 1


def test_an_app_of_one_pod_gets_servers_when_programs_outside_are_to_join() -> None:
    alone = component("driver")
    assert desired_of(make_app(alone), "").discovery == "None"
    assert desired_of(make_app(alone, ros2={"external": {"expose": "NodePort"}}), "").discovery == "Server"


def test_a_zenoh_router_is_opened_by_one_service() -> None:
    app = make_app(ros2={"rmw": "rmw_zenoh_cpp", "external": {"expose": "LoadBalancer"}})
    children = wanted_children(desired_of(app, ""), domain=Domain(7), parameters={}, running=True)
    (entrance,) = [child for child in children if child.spec.get("type") == "LoadBalancer"]
    assert entrance.spec["ports"][0]["protocol"] == "TCP"


def test_the_entrances_are_shown_with_the_helpers_they_lead_to() -> None:
    app = make_app(ros2={"external": {"expose": "NodePort"}})
    labels = {"robotics.io/role": "discovery", "robotics.io/part": "1"}
    metadata = TenantMeta(name="entrance", namespace="default", labels=labels)
    service = Service(
        metadata=metadata, text=b'{"type":"NodePort","ports":[{"name":"outside","port":11811,"nodePort":30811}]}'
    )
    links = list_links(desired_of(app, ""), {"entrance": service}, {"driver": "amr-07"}, lambda _: "192.0.2.7")
    assert links == (LinkView("discovery-1", "outside", "192.0.2.7:30811"),)


def test_links_keep_to_what_the_api_server_takes_so_that_no_status_is_refused() -> None:
    link = {"name": "outside", "port": "http"}
    parts = component("discovery-0", service={"spec": {"ports": [HTTP]}, "links": [link]}), component("driver")
    app = make_app(*parts, ros2={"external": {"expose": "NodePort"}})
    labels = {"robotics.io/role": "discovery", "robotics.io/part": "0"}
    entrance = Service(
        metadata=TenantMeta(name="entrance", namespace="default", labels=labels),
        text=b'{"type":"NodePort","ports":[{"name":"outside","port":11811,"nodePort":30811}]}',
    )
    (child,) = component_services(desired_of(app, ""))
    own = Service(
        metadata=TenantMeta(name=child.ref.name, namespace="default"), text=b'{"ports":[{"name":"http","port":80}]}'
    )
    services = {"entrance": entrance, child.ref.name: own}
    links = list_links(desired_of(app, ""), services, {"driver": "amr-07"}, lambda _: "192.0.2.7")
    assert [link.url for link in links] == [f"http://{child.ref.name}.default.svc:80"]

    balanced = app_with([link | {"scheme": "foxglove", "path": "/" + "!" * 255}], type="LoadBalancer")
    assert links_of(balanced, ingress=[Ingress(hostname="a" * 253)]) == (), "1094 characters, of 1024"
    assert links_of(balanced, ingress=[Ingress(hostname="a" * 63)])


def test_discovery_without_an_address_cannot_be_opened_and_the_cure_is_named() -> None:
    spec = make_app(ros2={"rmw": "rmw_cyclonedds_cpp", "external": {"expose": "NodePort"}}).spec
    (problem,) = spec_problems(spec)
    assert problem.field == "spec.ros2.external"
    assert "use rmw_zenoh_cpp" in problem.message
