"""What a published example is here: where it comes from, the objects it becomes, and what must be true of them once they run."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from robotapp_api.model.names import API_VERSION, Label

Json = dict[str, Any]
X11 = "/tmp/.X11-unix"  # noqa: S108 - the socket of a display, on every Linux machine
SHARED_MEMORY = "/dev/shm"  # noqa: S108 - where POSIX shared memory is


class Verdict(StrEnum):
    """Whether an example runs as its authors wrote it: every variable, port, volume, command and access to the node."""

    YES = "yes"
    REDUCED = "reduced"
    NO = "no"


@dataclass(frozen=True, slots=True)
class Running:
    """The objects of one example on the live control plane, read after its apps became Ready."""

    pods: Sequence[Json]
    services: Sequence[Json]
    instances: Sequence[Json]
    tiers: Mapping[str, str]
    """Tier of each node by name."""

    def pods_of(self, component: str) -> list[Json]:
        return [pod for pod in self.pods if pod["metadata"]["labels"].get(Label.COMPONENT) == component]

    def container(self, component: str, name: str = "") -> Json:
        """Returns a container of the component's first pod, the component's own without a name."""
        spec = self.pods_of(component)[0]["spec"]
        (container,) = (
            item
            for item in [*spec["containers"], *spec.get("initContainers", ())]
            if item["name"] == (name or component)
        )
        return container

    def service_of(self, component: str) -> Json:
        (service,) = (
            item for item in self.services if item["metadata"].get("labels", {}).get(Label.COMPONENT) == component
        )
        return service


@dataclass(frozen=True, slots=True)
class Promise:
    """One thing that the example's authors rely on. `read` returns what is there, which must equal `expected`."""

    what: str
    read: Callable[[Running], object]
    expected: object = True


@dataclass(frozen=True, slots=True)
class Example:
    """`source` names the repository or page; `beside` are the authors' other objects, which stay as they are."""

    title: str
    source: str
    apps: Sequence[Json] = ()
    beside: Sequence[Json] = ()
    promises: Sequence[Promise] = ()
    verdict: Verdict = Verdict.YES


def part(name: str, image: str, **fields: Any) -> Json:
    return {"name": name, "image": image, **fields}


def make_app(name: str, distro: str, *components: Json, **spec: Any) -> Json:
    body = {"ros": {"distro": distro}, "components": list(components), **spec}
    return {"apiVersion": API_VERSION, "kind": "RobotApp", "metadata": {"name": name}, "spec": body}


def shell(script: str) -> Json:
    """Returns the fields of a container that runs a script of the authors in place of the entry point."""
    return {"command": ["/bin/bash", "-c"], "args": [script]}


def env(**values: str) -> list[Json]:
    return [{"name": name, "value": value} for name, value in values.items()]


def host_path(name: str, path: str, kind: str = "") -> Json:
    return {"name": name, "hostPath": {"path": path, **({"type": kind} if kind else {})}}


def mount(name: str, path: str, **fields: Any) -> Json:
    return {"name": name, "mountPath": path, **fields}


def config_map(name: str, **data: str) -> Json:
    return {"apiVersion": "v1", "kind": "ConfigMap", "metadata": {"name": name}, "data": data}


def service(name: str, pods: Mapping[str, str], port: int, **fields: Any) -> Json:
    """Returns a Service as the authors wrote it beside their pods, chosen by a label of the authors' own."""
    spec = {"selector": dict(pods), "ports": [{"port": port}], **fields}
    return {"apiVersion": "v1", "kind": "Service", "metadata": {"name": name}, "spec": spec}


def has_pod_fields(component: str, **fields: object) -> Promise:
    return Promise(
        f"{component}: {', '.join(fields)}",
        lambda running: {name: running.pods_of(component)[0]["spec"].get(name) for name in fields},
        fields,
    )


def has_container_fields(component: str, container: str = "", **fields: object) -> Promise:
    return Promise(
        f"{component}/{container or component}: {', '.join(fields)}",
        lambda running: {name: running.container(component, container).get(name) for name in fields},
        fields,
    )


def has_variables(component: str, container: str = "", **values: str) -> Promise:
    def read(running: Running) -> dict[str, str | None]:
        stored = {item["name"]: item.get("value") for item in running.container(component, container)["env"]}
        return {name: stored.get(name) for name in values}

    return Promise(f"{component}/{container or component}: variables {', '.join(values)}", read, values)


def mounts(component: str, path: str, source: Json, container: str = "") -> Promise:
    """The container sees at `path` the volume whose source is, or contains, `source`."""

    def read(running: Running) -> Json:
        pod = running.pods_of(component)[0]["spec"]
        (name,) = (
            item["name"]
            for item in running.container(component, container)["volumeMounts"]
            if item["mountPath"] == path
        )
        (volume,) = (item for item in pod["volumes"] if item["name"] == name)
        return {
            kind: {key: volume.get(kind, {}).get(key) for key in fields} if isinstance(fields, dict) else volume[kind]
            for kind, fields in source.items()
        }

    return Promise(f"{component}/{container or component}: {path}", read, source)


def share_a_domain(*places: tuple[str, str]) -> Promise:
    """Containers, each as component and name, are in one ROS domain, and it is not that of everybody."""

    def read(running: Running) -> bool:
        ids = {
            item["value"]
            for component, name in places
            for item in running.container(component, name)["env"]
            if item["name"] == "ROS_DOMAIN_ID"
        }
        counts = [sum(item["name"] == "ROS_DOMAIN_ID" for item in running.container(*place)["env"]) for place in places]
        return len(ids) == 1 and "0" not in ids and counts == [1] * len(places)

    return Promise(f"{', '.join('/'.join(place).rstrip('/') for place in places)}: one domain", read)


def has_no_ros(component: str) -> Promise:
    return Promise(
        f"{component}: no variable of ROS",
        lambda running: [
            item["name"]
            for item in running.container(component).get("env", ())
            if item["name"].startswith(("ROS_", "RMW_"))
        ],
        [],
    )


def runs_on(component: str, *tiers: str) -> Promise:
    return Promise(
        f"{component}: on {' or '.join(tiers)}",
        lambda running: (
            running.pods_of(component) != []
            and {running.tiers[pod["spec"]["nodeName"]] for pod in running.pods_of(component)} <= {*tiers}
        ),
    )


def has_pods(component: str, count: int) -> Promise:
    return Promise(
        f"{component}: {count} pods on {count} nodes",
        lambda running: (
            len(running.pods_of(component)),
            len({pod["spec"]["nodeName"] for pod in running.pods_of(component)}),
        ),
        (count, count),
    )


def has_service(component: str, kind: str, *ports: tuple[int, str]) -> Promise:
    """The component has a Service of this type with these ports, and a port of the node for each unless it is ClusterIP."""

    def read(running: Running) -> object:
        spec = running.service_of(component)["spec"]
        open_ports = [bool(port.get("nodePort")) == (kind != "ClusterIP") for port in spec["ports"]]
        return spec["type"], [(port["port"], port["protocol"]) for port in spec["ports"]], all(open_ports)

    return Promise(f"{component}: Service {kind}", read, (kind, list(ports), True))


def has_link(component: str, name: str, scheme: str, path: str = "") -> Promise:
    """The status of the instance shows the address that a browser opens."""

    def read(running: Running) -> bool:
        links = [link for item in running.instances for link in item["status"].get("links", ())]
        urls = [link["url"] for link in links if (link["component"], link["name"]) == (component, name)]
        return bool(urls) and all(url.startswith(f"{scheme}://") and url.endswith(path) for url in urls)

    return Promise(f"{component}: link {name}", read)


def is_chosen_by(service_name: str, component: str) -> Promise:
    """A Service that the authors wrote beside their pods still chooses the component's pods, by the authors' label."""

    def read(running: Running) -> bool:
        (stored,) = (item for item in running.services if item["metadata"]["name"] == service_name)
        selector = stored["spec"]["selector"].items()
        chosen = [selector <= pod["metadata"]["labels"].items() for pod in running.pods_of(component)]
        return chosen != [] and all(chosen)

    return Promise(f"Service {service_name}: the pods of {component}", read)
