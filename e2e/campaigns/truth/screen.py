"""What a user sees of an app, and what is so: status, table, events and texts beside the raw objects."""

import json
from dataclasses import dataclass, field
from typing import Any

from typer.testing import CliRunner

from campaigns.rigs.simulated_site import APIS, Object, SimulatedSite
from robotapp_api.model.names import Label
from robotapp_cli.main import app as command_line

INSTANCE_LABELS = f"{Label.APP_UID}%3D"


@dataclass(frozen=True, slots=True)
class Screen:
    """One look at an app. `row` is the line of `kubectl get ra -o wide` by column name, `info` the text of the CLI."""

    app: Object
    instances: list[Object]
    deployments: list[Object]
    pods: list[Object]
    claims: list[Object]
    nodes: dict[str, Object]
    telemetry: dict[str, Object]
    events: list[Object]
    row: dict[str, str]
    info: str
    all_pods: list[Object] = field(default_factory=list)
    """Of the whole cluster, for what is free on nodes."""
    pod_events: list[Object] = field(default_factory=list)
    explained: Object = field(default_factory=dict)
    """`kubectl robotapp explain -o json`."""
    explanation: str = ""
    """The same as a table."""
    status: Object = field(default_factory=dict)

    @property
    def name(self) -> str:
        return f"{self.app['metadata']['namespace']}/{self.app['metadata']['name']}"

    @property
    def components(self) -> list[str]:
        return [each["name"] for each in self.app["spec"]["components"]]

    def component(self, name: str) -> Object:
        """Its part of the spec."""
        return next((each for each in self.app["spec"]["components"] if each["name"] == name), {})

    def edges_of(self, component: str) -> list[Object]:
        return [each for each in self.app["spec"].get("edges", ()) if component in (each["from"], each["to"])]

    def partners(self, component: str, field: str) -> list[str]:
        """The others that it names in this field, or that name it."""
        others = [each["name"] for each in self.app["spec"]["components"] if component in each.get(field, ())]
        return [*self.component(component).get(field, ()), *others]

    def tier(self, node: str) -> str:
        labels = self.nodes[node]["metadata"].get("labels", {}) if node in self.nodes else {}
        return "robot" if Label.ROBOT.value in labels else str(labels.get(Label.TIER, ""))

    @property
    def robot_nodes(self) -> list[str]:
        return [name for name, node in self.nodes.items() if Label.ROBOT.value in node["metadata"].get("labels", {})]

    def robot_is_there(self, robot: str) -> bool:
        return any(self.nodes[name]["metadata"]["labels"][Label.ROBOT.value] == robot for name in self.robot_nodes)

    def nodes_of(self, component: str) -> list[str]:
        return [pod["spec"]["nodeName"] for pod in self.pods_of(component) if pod["spec"].get("nodeName")]

    def pods_of(self, component: str) -> list[Object]:
        return [pod for pod in self.pods if pod["metadata"]["labels"].get(Label.COMPONENT.value) == component]

    def pods_on(self, node: str) -> list[Object]:
        return [pod for pod in self.all_pods if pod["spec"].get("nodeName") == node]

    def reported(self, one: str, other: str) -> list[tuple[float, float]]:
        """p50 and p95 in ms of this pair as its agents report now, infinite where no probe is answered."""
        return [
            (entry.get("p50Us", float("inf")) / 1000, entry.get("p95Us", float("inf")) / 1000)
            for here, there in ((one, other), (other, one))
            for entry in (self.telemetry.get(here) or {}).get("status", {}).get("rtt", ())
            if entry["peer"] == there
        ]

    def condition(self, kind: str) -> tuple[str, str, str]:
        """Status, reason and message."""
        (found,) = [each for each in self.status["conditions"] if each["type"] == kind]
        return found["status"], found["reason"], found["message"]

    @property
    def event_reasons(self) -> set[str]:
        return {each["reason"] for each in self.events}

    @property
    def messages(self) -> list[str]:
        """Every sentence about the app and its instances."""
        statuses = [self.status, *(each.get("status", {}) for each in self.instances)]
        found = [each["message"] for status in statuses for each in status.get("conditions", ())]
        found += [each.get("message", "") for status in statuses for each in status.get("components", ())]
        found += [each["message"] for each in self.status.get("troubled", ())]
        found += [status.get("summary", {}).get("message", "") for status in statuses]
        return [text for text in [*found, *(each["note"] for each in self.events)] if text]


def look(site: SimulatedSite, name: str) -> Screen:
    """Everything at about the same time; whoever compares looks again when something differs."""
    cp = site.cp
    app = site.app(name)
    uid = app["metadata"]["uid"]

    def listed(prefix: str, kind: str) -> list[Object]:
        path = f"{prefix}/namespaces/{site.namespace}/{kind}?labelSelector={INSTANCE_LABELS}{uid}"
        items: list[Object] = cp.api.get(path)["items"]
        return items

    def by_name(path: str) -> dict[str, Object]:
        return {item["metadata"]["name"]: item for item in cp.api.get(path)["items"]}

    all_pods = [
        pod for pod in cp.api.get("/api/v1/pods")["items"] if pod["status"].get("phase") not in ("Succeeded", "Failed")
    ]
    pods = listed("/api/v1", "pods")
    return Screen(
        app=app,
        all_pods=all_pods,
        pod_events=site.events_of_pods({pod["metadata"]["uid"] for pod in pods}),
        explained=json.loads(spoken(site, "explain", name, "-o", "json", scheduler=True)),
        explanation=spoken(site, "explain", name, scheduler=True),
        status=app.get("status", {}),
        instances=listed(APIS, "robotappinstances"),
        deployments=listed("/apis/apps/v1", "deployments"),
        pods=[pod for pod in pods if pod["status"].get("phase") not in ("Succeeded", "Failed")],
        claims=[claim for claim in site.claims() if claim["spec"]["holder"]["uid"] == uid],
        nodes=by_name("/api/v1/nodes"),
        telemetry=by_name(f"{APIS}/nodetelemetries"),
        events=site.events(name),
        row=_row(site, name),
        info=spoken(site, "info", name),
    )


def _row(site: SimulatedSite, name: str) -> dict[str, str]:
    heading, line = site.kubectl("get", "ra", name, "-o", "wide").splitlines()[:2]
    starts = [heading.index(word) for word in heading.split()]
    cells = [line[start:end].strip() for start, end in zip(starts, [*starts[1:], None], strict=True)]
    return dict(zip(heading.split(), cells, strict=True))


def spoken(site: SimulatedSite, *words: str, everywhere: bool = False, scheduler: bool = False) -> str:
    """What `kubectl robotapp` prints, of the site's namespace unless it is about everywhere; `scheduler`: it is asked there."""
    arguments = [*words, "--kubeconfig", str(site.cp.kubeconfig())]
    arguments += [] if everywhere else ["-n", site.namespace]
    arguments += ["--scheduler-url", str(site.scheduler.health_url)] if scheduler else []
    found = CliRunner().invoke(command_line, arguments, env={"COLUMNS": "200"})
    if found.exit_code:
        raise AssertionError(f"{words}: exit {found.exit_code}: {found.output}")
    return str(found.output)


def replicas_up(deployment: Object) -> bool:
    """Does the Deployment run as many ready pods of its newest template as it wants?"""
    wanted, status = deployment["spec"].get("replicas", 1), deployment.get("status", {})
    current = status.get("observedGeneration", 0) >= deployment["metadata"]["generation"]
    return bool(current and 0 < wanted == status.get("readyReplicas", 0) == status.get("updatedReplicas", 0))


def is_component(obj: Object) -> bool:
    return Label.COMPONENT.value in obj["metadata"]["labels"]


def node_ready(node: Object | None) -> bool:
    conditions: list[dict[str, Any]] = node["status"].get("conditions", []) if node else []
    return any(each["type"] == "Ready" and each["status"] == "True" for each in conditions)
