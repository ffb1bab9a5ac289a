"""What an instance needs beside its components: discovery servers, a Zenoh router, a roscore."""

from collections.abc import Mapping
from typing import Any, Final

from robotapp_api.model.names import Label
from robotapp_api.values.placement.component_nodes import is_in, required_nodes, robot_tolerations
from robotapp_operator.plan.render.child import DEPLOYMENT, Child, role_labels, selector
from robotapp_operator.plan.render.deployments import deployment_spec
from robotapp_operator.plan.render.environment import DISCOVERY_SERVER_PORT, ZENOH_PORT
from robotapp_operator.plan.render.node_affinity import (
    disconnect_tolerations,
    scheduling_gates,
    shared_node_selector,
    shared_tolerations,
)
from robotapp_operator.plan.render.ros1 import MASTER_PORT, own_address
from robotapp_operator.plan.render.services import DISCOVERY, role_service, servers_service
from robotapp_operator.plan.spec.desired import MASTER, ROUTER, SERVERS, Desired
from robotapp_operator.plan.spec.objects import ChildRef

ROUTER_ROLE: Final = "router"
MASTER_ROLE: Final = "master"


def infrastructure(desired: Desired, *, running: bool) -> list[Child]:
    """Deployments and Services of the instance's discovery, possibly none."""
    if desired.app.ros_version == 1:
        return _master(desired, running=running) if desired.app.managed_master else []
    if desired.discovery == "Server":
        return [*(_server(desired, index, running=running) for index in range(len(SERVERS))), servers_service(desired)]
    return _router(desired, running=running) if desired.discovery == "Router" else []


def _server(desired: Desired, index: int, *, running: bool) -> Child:
    """Fast DDS discovery server `index`. Data flows pod to pod; the server only introduces participants."""
    labels = role_labels(desired, DISCOVERY) | {Label.PART.value: str(index)}
    image = desired.app.discovery_image or f"ros:{desired.distro}-ros-base"
    container = {
        "name": DISCOVERY,
        "image": image,
        "args": ["fastdds", "discovery", "-i", str(index), "-p", str(DISCOVERY_SERVER_PORT)],
        "ports": [{"containerPort": DISCOVERY_SERVER_PORT, "protocol": "UDP"}],
    }
    # The first server stays with the robot, so that its components find each other while it is out of reach.
    home = desired.robot if index == 0 else ""
    identity = {"hostname": desired.server_hosts[index], "subdomain": desired.servers_service}
    return _deployment(desired, SERVERS[index], labels, container, home=home, running=running, identity=identity)


def _router(desired: Desired, *, running: bool) -> list[Child]:
    """Zenoh router from the first component's image, which has rmw_zenoh_cpp or could not run at all."""
    labels = role_labels(desired, ROUTER_ROLE)
    container = {
        "name": ROUTER_ROLE,
        "image": desired.app.discovery_image or desired.app.spec.components[0].image,
        "args": ["ros2", "run", "rmw_zenoh_cpp", "rmw_zenohd"],
        # The default listens on IPv6 only and fails where there is none.
        "env": [{"name": "ZENOH_CONFIG_OVERRIDE", "value": f'listen/endpoints=["tcp/0.0.0.0:{ZENOH_PORT}"]'}],
        "ports": [{"containerPort": ZENOH_PORT, "protocol": "TCP"}],
        "readinessProbe": {"tcpSocket": {"port": ZENOH_PORT}},
    }
    service = role_service(
        desired,
        name=desired.router_name,
        role=ROUTER_ROLE,
        labels=labels,
        port=ZENOH_PORT,
        protocol="TCP",
        headless=False,
    )
    return [_deployment(desired, ROUTER, labels, container, home=desired.robot, running=running), service]


def _master(desired: Desired, *, running: bool) -> list[Child]:
    """roscore: a name service; nodes then connect to each other."""
    labels = role_labels(desired, MASTER_ROLE)
    image = (desired.app.spec.ros1.image if desired.app.spec.ros1 else "") or f"ros:{desired.distro}-ros-core"
    container = {
        "name": MASTER_ROLE,
        "image": image,
        "args": ["roscore", "-p", str(MASTER_PORT)],
        "env": [own_address()],
        "ports": [{"containerPort": MASTER_PORT, "protocol": "TCP"}],
        "readinessProbe": {"tcpSocket": {"port": MASTER_PORT}},
    }
    service = role_service(
        desired,
        name=desired.master_name,
        role=MASTER_ROLE,
        labels=labels,
        port=MASTER_PORT,
        protocol="TCP",
        headless=True,
    )
    return [
        _deployment(
            desired,
            MASTER,
            labels,
            container,
            home=desired.robot,
            running=running,
            node=desired.app.spec.placement.master_node,
        ),
        service,
    ]


def _deployment(
    desired: Desired,
    part: str,
    labels: dict[str, str],
    container: dict[str, Any],
    *,
    home: str,
    running: bool,
    node: str = "",
    identity: Mapping[str, str] = {},
) -> Child:
    """identity: the pod's `hostname` and `subdomain`."""
    spec: dict[str, Any] = {
        "schedulerName": desired.app.scheduler_name,
        "automountServiceAccountToken": False,
        "enableServiceLinks": False,
        "containers": [container],
        **identity,
        **scheduling_gates(desired),
    }
    affinity = _affinity(labels, home=home, node=node)
    if affinity:
        spec["affinity"] = affinity
    tolerations = shared_tolerations(desired) + (robot_tolerations(home) + disconnect_tolerations(None) if home else [])
    if tolerations:
        spec["tolerations"] = tolerations
    if node_selector := shared_node_selector(desired):
        spec["nodeSelector"] = node_selector
    template = {"metadata": {"labels": labels}, "spec": spec}
    return Child(
        ref=ChildRef(DEPLOYMENT, desired.name_of(part)),
        labels=labels,
        spec=deployment_spec(labels, template, replicas=1, running=running),
    )


def _affinity(labels: dict[str, str], *, home: str, node: str) -> dict[str, Any]:
    """On `node` when given; else on the robot `home`; siblings of one role preferably on different nodes."""
    result: dict[str, Any] = {}
    if node:
        result["nodeAffinity"] = required_nodes([[is_in(Label.HOSTNAME, node)]])
    elif home:
        preference = {"weight": 100, "preference": {"matchExpressions": [is_in(Label.ROBOT, home)]}}
        result["nodeAffinity"] = {"preferredDuringSchedulingIgnoredDuringExecution": [preference]}
    if Label.PART.value in labels:
        siblings = {key: value for key, value in selector(labels).items() if key != Label.PART.value}
        term = {"topologyKey": Label.HOSTNAME.value, "labelSelector": {"matchLabels": siblings}}
        result["podAntiAffinity"] = {
            "preferredDuringSchedulingIgnoredDuringExecution": [{"weight": 100, "podAffinityTerm": term}]
        }
    return result
