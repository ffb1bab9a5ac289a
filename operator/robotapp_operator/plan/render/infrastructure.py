"""What an instance needs beside its components: discovery servers, a Zenoh router, a roscore."""

from typing import Any, Final

from robotapp_api.model.distros import IPV6
from robotapp_api.model.names import Label
from robotapp_operator.plan.render.child import DEPLOYMENT, Child, role_labels
from robotapp_operator.plan.render.deployments import deployment_spec
from robotapp_operator.plan.render.environment import DISCOVERY_SERVER_PORT, MASTER_PORT, ZENOH_PORT, own_address
from robotapp_operator.plan.render.helper_pods import QUICK_END, render_helper
from robotapp_operator.plan.render.services import DISCOVERY, outside_service, role_service, servers_service
from robotapp_operator.plan.spec.desired import MASTER, ROUTER, SERVERS, Desired
from robotapp_operator.plan.spec.links import OUTSIDE
from robotapp_operator.plan.spec.objects import ChildRef

ROUTER_ROLE: Final = "router"
_LISTEN: Final = f'listen/endpoints=["tcp/[::]:{ZENOH_PORT}","tcp/0.0.0.0:{ZENOH_PORT}"];listen/exit_on_failure=false'
"""Both IP families. The default is IPv6 alone and ends where there is none; where `[::]` serves both, the second fails and may."""
_POD_IP: Final = "ROBOTAPP_POD_IP"
MASTER_ROLE: Final = "master"
MASTER_PERIOD_S: Final = 2
"""Nodes of a master that was started anew are restarted as soon as it is ready."""


def infrastructure(desired: Desired, *, running: bool) -> list[Child]:
    """Deployments and Services of the instance's discovery, possibly none; stopped while all components with ROS are suspended."""
    running = running and any(component.replicas for component in desired.app.ros_components)
    if desired.app.ros_version == 1:
        return _master(desired, running=running) if desired.app.managed_master else []
    if desired.discovery == "Server":
        servers = [_server(desired, index, running=running) for index in range(len(SERVERS))]
        return [*servers, servers_service(desired), *_outside(desired)]
    return [*_router(desired, running=running), *_outside(desired)] if desired.discovery == "Router" else []


def _outside(desired: Desired) -> list[Child]:
    """Returns a Service for each helper that programs outside of the cluster are to reach: one for each server, since a client
    must reach both, and a Service for two would give it one of them.
    """
    external = desired.app.spec.ros2.external if desired.app.spec.ros2 else None
    if external is None:
        return []
    return [
        outside_service(
            name=desired.name_of(f"{OUTSIDE}.{part}"),
            labels=labels,
            port=port,
            protocol=protocol,
            expose=external.expose,
        )
        for part, labels, port, protocol in _entrances(desired)
    ]


def _entrances(desired: Desired) -> list[tuple[str, dict[str, str], int, str]]:
    """Returns name, labels, port and protocol of the helpers that participants talk to first."""
    if desired.discovery == "Router":
        return [(ROUTER_ROLE, role_labels(desired, ROUTER_ROLE), ZENOH_PORT, "TCP")]
    return [
        (host, role_labels(desired, DISCOVERY) | {Label.PART.value: str(index)}, DISCOVERY_SERVER_PORT, "UDP")
        for index, host in enumerate(desired.server_hosts)
    ]


def _server(desired: Desired, index: int, *, running: bool) -> Child:
    """Fast DDS discovery server `index`. Data flows pod to pod; the server only introduces participants."""
    labels = role_labels(desired, DISCOVERY) | {Label.PART.value: str(index)}
    container = {
        "name": DISCOVERY,
        "image": desired.app.helper_image or _fill_image(desired.app.helper_defaults.discovery_image, desired),
        "args": ["fastdds", "discovery", "-i", str(index), "-p", str(DISCOVERY_SERVER_PORT)],
        "ports": [{"containerPort": DISCOVERY_SERVER_PORT, "protocol": "UDP"}],
    }
    if desired.app.helper_defaults.ip_family == IPV6:
        _listen_on_ipv6(container)
    # The first server stays with the robot, so that its components find each other while it is out of reach.
    home = desired.robot_name if index == 0 else ""
    pod_fields = {**QUICK_END, "hostname": desired.server_hosts[index], "subdomain": desired.servers_service}
    template = render_helper(desired, container, labels, home=home, pod_fields=pod_fields)
    return _deployment(desired, SERVERS[index], labels, template, running=running)


def _listen_on_ipv6(container: dict[str, Any]) -> None:
    """Has the server listen on the pod's own address: by itself it takes IPv4 alone, and `-l ::` it cannot (Fast DDS 2.9)."""
    container["args"] += ["-l", f"$({_POD_IP})"]
    container["env"] = [{"name": _POD_IP, "valueFrom": {"fieldRef": {"fieldPath": "status.podIP"}}}]


def _fill_image(text: str, desired: Desired) -> str:
    return text.replace("{distro}", desired.distro)


def _router(desired: Desired, *, running: bool) -> list[Child]:
    """Zenoh router from the first component's image, which has rmw_zenoh_cpp or could not run at all."""
    labels = role_labels(desired, ROUTER_ROLE)
    first = desired.app.ros_components[0]
    container = {
        "name": ROUTER_ROLE,
        "image": desired.app.helper_image or first.image,
        "args": ["ros2", "run", "rmw_zenoh_cpp", "rmw_zenohd"],
        "env": [{"name": "ZENOH_CONFIG_OVERRIDE", "value": _LISTEN}],
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
    image_of = None if desired.app.helper_image else first
    template = render_helper(
        desired, container, labels, home=desired.robot_name, image_of=image_of, pod_fields=QUICK_END
    )
    return [_deployment(desired, ROUTER, labels, template, running=running), service]


def _master(desired: Desired, *, running: bool) -> list[Child]:
    """roscore: a name service; nodes then connect to each other."""
    labels = role_labels(desired, MASTER_ROLE)
    container = {
        "name": MASTER_ROLE,
        "image": desired.app.helper_image or _fill_image(desired.app.helper_defaults.master_image, desired),
        "args": ["roscore", "-p", str(MASTER_PORT)],
        "env": [own_address()],
        "ports": [{"containerPort": MASTER_PORT, "protocol": "TCP"}],
        "readinessProbe": {"tcpSocket": {"port": MASTER_PORT}, "periodSeconds": MASTER_PERIOD_S},
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
    node = desired.app.spec.placement.master_node
    template = render_helper(desired, container, labels, home=desired.robot_name, node=node)
    return [_deployment(desired, MASTER, labels, template, running=running), service]


def _deployment(
    desired: Desired, part: str, labels: dict[str, str], template: dict[str, Any], *, running: bool
) -> Child:
    return Child(
        ref=ChildRef(DEPLOYMENT, desired.name_of(part)),
        labels=labels,
        spec=deployment_spec(labels, template, replicas=1, running=running),
    )
