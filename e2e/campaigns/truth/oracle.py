"""The judge: which sentences on the screen contradict the cluster. It knows Kubernetes' objects and none of our code."""

import re
from collections.abc import Iterator
from functools import cache

from campaigns.rigs.simulated_site import Object
from campaigns.truth.explained import false_explanation
from campaigns.truth.history import History
from campaigns.truth.screen import Screen, is_component, node_ready, replicas_up
from campaigns.truth.told import false_events
from robotapp_api.model.app.robotapp import RobotApp
from robotapp_api.model.names import Label
from robotapp_api.model.pool import DomainPool
from robotapp_cli.main import app as command_line

KUBECTL = {"get", "describe", "explain", "logs", "delete", "label", "annotate", "apply", "edit", "auth", "robotapp"}


def contradictions(screen: Screen, history: History) -> list[str]:
    """Empty when everything on the screen is so, and was so when it was told."""
    rules = (_counts, _ready, _placed, _domains, _devices, _budget, _phase, _table, _accepted, _instances, _advice)
    found = [text for rule in rules for text in rule(screen)]
    return [*found, *false_events(screen, history), *false_explanation(screen, history)]


def _components(screen: Screen, instance: str | None = None) -> list[Object]:
    return [
        each
        for each in screen.deployments
        if is_component(each) and instance in (None, each["metadata"]["labels"].get(Label.INSTANCE, ""))
    ]


def _wanted(screen: Screen) -> int:
    return len(screen.app["spec"]["components"]) * max(screen.status["instanceCounts"]["desired"], 1)


def _counts(screen: Screen) -> Iterator[str]:
    counts = screen.status["instanceCounts"]
    if counts["desired"] != len(screen.instances):
        yield f"instanceCounts.desired {counts['desired']}, but there are {len(screen.instances)} RobotAppInstances"
    offline = [each for each in screen.instances if each["status"].get("phase") == "Offline"]
    if counts["offline"] < len(offline):
        yield f"instanceCounts.offline {counts['offline']}, but {len(offline)} are Offline"
    for each in offline:
        own = [node for node in screen.nodes.values() if node["metadata"]["labels"].get(Label.ROBOT) == _robot(each)]
        if own and all(map(node_ready, own)):
            yield f"{each['metadata']['name']} is Offline, but its nodes are ready"


def _robot(instance: Object) -> str:
    return str(instance["spec"].get("robot", ""))


def _ready(screen: Screen) -> Iterator[str]:
    up = sum(map(replicas_up, _components(screen)))
    wanted = _wanted(screen)
    if screen.row["READY"] != f"{up}/{wanted}":
        yield f"READY {screen.row['READY']}, but {up} of {wanted} Deployments are up"
    status, reason, _ = screen.condition("Ready")
    if (status == "True") != (up == wanted and reason == "AllComponentsReady"):
        yield f"Ready={status} ({reason}), but {up} of {wanted} Deployments are up"


def _placed(screen: Screen) -> Iterator[str]:
    status, _, text = screen.condition("Placed")
    pods = [pod for pod in screen.pods if is_component(pod) and not pod["metadata"].get("deletionTimestamp")]
    bound = [pod for pod in pods if pod["spec"].get("nodeName")]
    wanted = sum(each["spec"].get("replicas", 1) for each in _components(screen))
    if status == "True" and not len(bound) == len(pods) == wanted:
        yield f"Placed=True, but {len(bound)} of {wanted} pods have a node"
    if status != "True" and wanted and len(bound) == len(pods) == wanted and not screen.app["spec"].get("suspend"):
        accepted, _, _ = screen.condition("Accepted")
        if accepted == "True":
            yield f"Placed={status} ({text}), but all {wanted} pods have a node"
    shown = set(filter(None, screen.row.get("NODES", "").split(",")))
    nodes = {pod["spec"]["nodeName"] for pod in bound}
    if shown != nodes and not any("…" in name for name in shown) and status != "False":
        yield f"NODES {sorted(shown)}, but pods are on {sorted(nodes)}"


def _domains(screen: Screen) -> Iterator[str]:
    held = {claim["spec"]["domain"]["id"] for claim in screen.claims if "domain" in claim["spec"]}
    status, reason, _ = screen.condition("Allocated")
    sharing = (screen.app["spec"].get("ros2") or {}).get("shareWith")
    used = set(filter(None, map(_domain_of, _components(screen))))
    if not sharing and status == "True" and reason == "Allocated" and used and not used <= held:
        yield f"Allocated=True, templates use domains {used}, claimed are {held}"
    shown = screen.row.get("DOMAIN", "")
    if shown.isdecimal() and not sharing and int(shown) not in held:
        yield f"DOMAIN {shown}, claimed are {held}"
    if status == "True" and used and len(used) == 1 and shown and shown != str(next(iter(used))):
        yield f"DOMAIN {shown}, templates use {used}"


def _domain_of(deployment: Object) -> int | None:
    for container in deployment["spec"]["template"]["spec"]["containers"]:
        for variable in container.get("env", ()):
            if variable["name"] == "ROS_DOMAIN_ID" and str(variable.get("value", "")).isdecimal():
                return int(variable["value"])
    return None


def _devices(screen: Screen) -> Iterator[str]:
    held = sum("device" in claim["spec"] for claim in screen.claims)
    shown = screen.row.get("DEVICES", "")
    if shown and int(shown.partition("/")[0]) != held:
        yield f"DEVICES {shown}, but {held} are claimed"


def _budget(screen: Screen) -> Iterator[str]:
    status, reason, text = screen.condition("BudgetMet")
    budgets = [edge for edge in screen.app["spec"].get("edges", ()) if edge.get("latency")]
    if (reason == "NoBudget") and budgets:
        yield f"BudgetMet {reason} ({text}), but {len(budgets)} edges have a budget"
    if not budgets or not screen.instances:
        return
    edges = [edge for each in screen.instances for edge in each["status"].get("edges", ()) if edge.get("budget")]
    if status == "True" and any(edge.get("met") is not True for edge in edges):
        yield "BudgetMet=True, but an instance's edge is not met"
    for edge in edges:
        yield from _measured(screen, edge)


def _measured(screen: Screen, edge: Object) -> Iterator[str]:
    nodes = edge.get("nodes", [])
    found = (
        [
            entry
            for one, other in (nodes, nodes[::-1])
            for entry in (screen.telemetry.get(one) or {}).get("status", {}).get("rtt", ())
            if len(nodes) == 2 and entry["peer"] == other
        ]
        if len(nodes) == 2
        else []
    )
    if edge.get("measured") and not found:
        yield f"{edge['topic']} is measured, but no node reports a time between {nodes}"
    if edge.get("met") is True and not found and len(set(nodes)) != 1:
        yield f"{edge['topic']} is met, but nothing was measured between {nodes}"


def _phase(screen: Screen) -> Iterator[str]:
    phase = screen.row["PHASE"]
    suspended = bool(screen.app["spec"].get("suspend"))
    accepted, _, _ = screen.condition("Accepted")
    ready, _, _ = screen.condition("Ready")
    if phase == "Running" and ready != "True":
        yield f"PHASE Running, but Ready={ready}"
    if ready == "True" and phase != "Running":
        yield f"Ready=True, but PHASE {phase}"
    if phase == "Failed" and accepted != "False":
        yield f"PHASE Failed, but Accepted={accepted}"
    if accepted == "True" and suspended != (phase in ("Suspended", "Stopping")):
        yield f"PHASE {phase}, but suspend is {suspended}"
    if phase == "Suspended" and [pod for pod in screen.pods if pod["spec"].get("nodeName")]:
        yield "PHASE Suspended, but pods are on nodes"
    if phase == "Offline" and any(each["status"].get("phase") != "Offline" for each in screen.instances):
        yield "PHASE Offline, but an instance is not"


def _table(screen: Screen) -> Iterator[str]:
    """The CLI's text has the phase and the conditions of the status."""
    if screen.row["PHASE"] not in screen.info:
        yield f"info does not say {screen.row['PHASE']}: {screen.info}"
    for kind in ("Ready", "Accepted", "Allocated", "Placed", "BudgetMet"):
        if screen.condition(kind)[1] not in screen.info and screen.condition(kind)[0] == "False":
            yield f"info does not give the reason {screen.condition(kind)[1]} of {kind}"


def _accepted(screen: Screen) -> Iterator[str]:
    status, reason, _ = screen.condition("Accepted")
    if status == "False" and screen.condition("Stalled")[0] != "True":
        yield f"Accepted=False ({reason}), but nothing is Stalled"
    if status == "False" and _components(screen) and screen.app["metadata"]["generation"] == 1 and not screen.pods:
        yield "Accepted=False from the start, but there are Deployments"


def _instances(screen: Screen) -> Iterator[str]:
    for each in screen.instances:
        status, instance = each["status"], each["spec"]["instance"]
        up = sum(map(replicas_up, _components(screen, instance)))
        if "summary" in status and status["summary"].get("ready") != f"{up}/{len(screen.app['spec']['components'])}":
            yield f"{each['metadata']['name']}: ready {status['summary'].get('ready')}, {up} Deployments are up"
        for component in status.get("components", ()):
            pods = [pod for pod in screen.pods if _is_of(pod, instance, component["name"])]
            nodes = {pod["spec"].get("nodeName") for pod in pods}
            if component.get("node") and component["node"] not in nodes:
                yield f"{component['name']} on {component['node']}, but its pods are on {nodes}"


def _is_of(pod: Object, instance: str, component: str) -> bool:
    labels = pod["metadata"]["labels"]
    return labels.get(Label.INSTANCE, "") == instance and labels.get(Label.COMPONENT) == component


def _advice(screen: Screen) -> Iterator[str]:
    """Commands exist, fields exist, nodes that are named exist."""
    for text in screen.messages:
        for verb, sub in re.findall(r"kubectl ([a-z-]+)(?: ([a-z-]+))?", text):
            if verb not in KUBECTL or (verb == "robotapp" and sub not in _commands()):
                yield f"advice kubectl {verb} {sub} does not exist: {text}"
        for path in re.findall(r"\bspec(?:\.[a-zA-Z0-9]+(?:\[\d+\])?)+", text):
            if not _is_field(re.sub(r"\[\d+\]", "", path)):
                yield f"there is no field {path}: {text}"
        for node in re.findall(r"\bnode ([a-z][a-z0-9-]*\d)\b", text):
            if node not in screen.nodes and "no node" not in text and "gone" not in text:
                yield f"there is no node {node}: {text}"


@cache
def _commands() -> frozenset[str]:
    return frozenset(str(each.name) for each in command_line.registered_commands)


@cache
def _is_field(path: str) -> bool:
    """Is this a path of a RobotApp or of a DomainPool, by the schema?"""
    return any(_has_path(kind.model_json_schema(by_alias=True), path) for kind in (RobotApp, DomainPool))


def _has_path(schema: Object, path: str) -> bool:
    here: Object | None = schema
    for step in path.split("."):
        here = _step(schema, here, step)
        if here is None:
            return False
        if not here:
            return True  # free-form from here on
    return True


def _step(root: Object, here: Object | None, name: str) -> Object | None:
    for option in _resolved(root, here or {}):
        properties = option.get("properties")
        if properties and name in properties:
            found: Object = properties[name]
            return found
        if option.get("type") == "object" and not properties:
            return {}
    return None


def _resolved(root: Object, schema: Object) -> Iterator[Object]:
    """The schema itself, what it refers to, its alternatives, and items of lists."""
    if "$ref" in schema:
        yield from _resolved(root, root["$defs"][schema["$ref"].rpartition("/")[2]])
        return
    for option in (*schema.get("anyOf", ()), *schema.get("allOf", ())):
        yield from _resolved(root, option)
    if schema.get("type") == "array":
        yield from _resolved(root, schema.get("items", {}))
        return
    yield schema
