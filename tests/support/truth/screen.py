"""What a user sees of an app, and what is so: status, table, events and texts beside the raw objects."""

from dataclasses import dataclass, field
from typing import Any

from tests.support.world import APIS, Object, World
from typer.testing import CliRunner

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
    status: Object = field(default_factory=dict)

    def condition(self, kind: str) -> tuple[str, str, str]:
        """Status, reason and message."""
        (found,) = [each for each in self.status["conditions"] if each["type"] == kind]
        return found["status"], found["reason"], found["message"]

    @property
    def messages(self) -> list[str]:
        """Every sentence about the app and its instances."""
        statuses = [self.status, *(each.get("status", {}) for each in self.instances)]
        found = [each["message"] for status in statuses for each in status.get("conditions", ())]
        found += [each.get("message", "") for status in statuses for each in status.get("components", ())]
        found += [each["message"] for each in self.status.get("troubled", ())]
        found += [status.get("summary", {}).get("message", "") for status in statuses]
        return [text for text in [*found, *(each["note"] for each in self.events)] if text]


def look(world: World, name: str) -> Screen:
    """Everything at about the same time; whoever compares looks again when something differs."""
    cp = world.cp
    app = world.app(name)
    uid = app["metadata"]["uid"]

    def listed(prefix: str, kind: str) -> list[Object]:
        path = f"{prefix}/namespaces/{world.namespace}/{kind}?labelSelector={INSTANCE_LABELS}{uid}"
        items: list[Object] = cp.api.get(path)["items"]
        return items

    def by_name(path: str) -> dict[str, Object]:
        return {item["metadata"]["name"]: item for item in cp.api.get(path)["items"]}

    return Screen(
        app=app,
        status=app.get("status", {}),
        instances=listed(APIS, "robotappinstances"),
        deployments=listed("/apis/apps/v1", "deployments"),
        pods=[pod for pod in listed("/api/v1", "pods") if pod["status"].get("phase") not in ("Succeeded", "Failed")],
        claims=[claim for claim in world.claims() if claim["spec"]["holder"]["uid"] == uid],
        nodes=by_name("/api/v1/nodes"),
        telemetry=by_name(f"{APIS}/nodetelemetries"),
        events=world.events(name),
        row=_row(world, name),
        info=_text(world, "info", name),
    )


def _row(world: World, name: str) -> dict[str, str]:
    heading, line = world.kubectl("get", "ra", name, "-o", "wide").splitlines()[:2]
    starts = [heading.index(word) for word in heading.split()]
    cells = [line[start:end].strip() for start, end in zip(starts, [*starts[1:], None], strict=True)]
    return dict(zip(heading.split(), cells, strict=True))


def _text(world: World, *words: str) -> str:
    arguments = [*words, "-n", world.namespace, "--kubeconfig", str(world.cp.kubeconfig())]
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
