"""The judge of `kubectl robotapp explain`: the chosen node, the refused ones with their numbers, the edges, what a plan is worth."""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from itertools import product
from typing import Any, Final, NamedTuple

from campaigns.rigs.simulated_site import Object
from campaigns.truth.history import History
from campaigns.truth.screen import Screen, is_component, node_ready
from robotapp_api.model.names import Annotation, Label
from robotapp_api.values.quantities.duration import parse_us
from robotapp_api.values.quantities.quantity import parse_milli


def admits(pod: Mapping[str, Any], node: Mapping[str, Any]) -> bool:
    """Does the node match the pod's nodeSelector and its required node affinity?"""
    spec, labels = pod["spec"], node["metadata"].get("labels", {})
    if any(labels.get(key) != value for key, value in (spec.get("nodeSelector") or {}).items()):
        return False
    affinity = ((spec.get("affinity") or {}).get("nodeAffinity") or {}).get(
        "requiredDuringSchedulingIgnoredDuringExecution"
    )
    if not affinity:
        return True
    fields = {"metadata.name": node["metadata"]["name"]}
    return any(
        all(_holds(each, labels) for each in term.get("matchExpressions", ()))
        and all(_holds(each, fields) for each in term.get("matchFields", ()))
        for term in affinity["nodeSelectorTerms"]
    )


def _holds(expression: Mapping[str, Any], values: Mapping[str, str]) -> bool:
    have, wanted = values.get(expression["key"]), expression.get("values", [])
    match expression["operator"]:
        case "In":
            return have in wanted
        case "NotIn":
            return have not in wanted
        case "Exists":
            return have is not None
        case "DoesNotExist":
            return have is None
        case "Gt":
            return have is not None and int(have) > int(wanted[0])
    return have is not None and int(have) < int(wanted[0])


SAME: Final = 0.2
"""An older figure may differ from the newest measurement by less than this share."""
CLEARLY: Final = 0.3
"""A plan is better for sure where each budgeted edge uses less of its budget by this share of it."""
_PAIR: Final = r"(?:about )?([\d.]+) ms to (.+) > ([\d.]+) ms"


def false_explanation(screen: Screen, history: History) -> Iterator[str]:
    """What `explain` tells that is not so."""
    found = screen.explained
    yield from _note(screen, found["note"])
    named = [row for view in found["instances"] for row in view["components"] if not row["component"].startswith("(")]
    yield from _rows(screen, named)
    for row in named:
        for text in (*_row(screen, history, row), *_tier(screen, row)):
            yield f"explain of {row['component']}: {text}"
    for view in found["instances"]:
        if view["robot"] not in {each["spec"].get("robot", "") for each in screen.instances} | {""}:
            yield f"explain has an instance of {view['robot']}"
        yield from _plan(screen, history, view)
        for edge in view["edges"]:
            for text in _edge(screen, history, edge):
                yield f"explain of {edge['topic']} ({edge}): {text}"
    for row in named:
        if row["node"] and row["node"] not in screen.explanation:
            yield f"the text of explain lacks {row['node']}"


def _note(screen: Screen, note: str) -> Iterator[str]:
    """All decisions are on record here, but for pods that wait and were not decided about."""
    again = re.fullmatch(r"No decision is on record of: (.*)\. Shown is what the scheduler would decide now\.", note)
    undecided = again[1].split(", ") if again else []
    if note and not undecided:
        yield f"explain: {note}"
    for name in undecided:
        if all(pod["spec"].get("nodeName") for pod in screen.pods_of(name)):
            yield f"explain: {note}, but {name} is on {screen.nodes_of(name)}"


# Rows


def _rows(screen: Screen, rows: Sequence[Object]) -> Iterator[str]:
    """Each pod has a row with its node, each component without one a row of its own."""
    shown = {row["pod"]: row["node"] for row in rows if row["pod"]}
    pods = {pod["metadata"]["name"]: pod["spec"].get("nodeName", "") for pod in screen.pods if is_component(pod)}
    if shown != pods:
        yield f"explain shows pods {shown}, there are {pods}"
    missing = set(screen.components) - {row["component"] for row in rows}
    if missing:
        yield f"explain lacks {missing}"
    for row in rows:
        if not row["node"] and not row["reasons"]:
            yield f"explain has no reason why {row['component']} waits"


def _row(screen: Screen, history: History, row: Object) -> Iterator[str]:
    pod = next((pod for pod in screen.pods if pod["metadata"]["name"] == row["pod"]), None)
    if pod is None or not row["recorded"]:
        return
    refused: list[str] = []
    more = 0
    for line in row["reasons"]:
        names, colon, reason = line.partition(": ")
        left = re.fullmatch(r"(.*?)(?: and )?(?:(\d+) more|(\d+) nodes)", names)
        listed = [name for name in (left[1] if left else names).split(", ") if name]
        if not colon or not all(_is_node_name(history, name) for name in listed):
            if row["node"]:
                yield f"not about nodes: {line}"
            continue
        refused += listed
        more += int(left[2] or left[3]) if left else 0
        for name in listed:
            yield from (f"{line}: {text}" for text in _refusal(Refused(screen, history, row, pod, name, reason)))
    if row["node"] in refused:
        yield f"{row['node']} was chosen and refused"
    nodes = len(history.facts("node", ..., until=datetime.now(UTC)))
    if len(set(refused)) != len(refused) or len(refused) + more > nodes - bool(row["node"]):
        yield f"{refused} and {more} more were refused, of {nodes} nodes"
    scores = row["scores"]
    if row["node"] and list(scores)[:1] != [row["node"]]:
        yield f"its scores begin with {list(scores)[:1]}, not with {row['node']}"
    if set(scores) & set(refused):
        yield f"{set(scores) & set(refused)} were refused and have scores"
    if row["runnerUp"] and (row["runnerUp"] == row["node"] or row["runnerUp"] not in scores):
        yield f"its runner-up is {row['runnerUp']}"
    claimed = {claim["spec"]["device"]["id"] for claim in screen.claims if "device" in claim["spec"]}
    for device in row["devices"]:
        if device not in claimed and not _is_shared(screen, row["component"]):
            yield f"device {device} is not claimed"


def _is_node_name(history: History, name: str) -> bool:
    return history.ever("node", name, until=datetime.now(UTC))


def _is_shared(screen: Screen, component: str) -> bool:
    return any(
        wish.get("sharing", "Exclusive") != "Exclusive" for wish in screen.component(component).get("devices", ())
    )


# Refused nodes


class Refused(NamedTuple):
    """One node that was refused for a pod, and the text why."""

    screen: Screen
    history: History
    row: Object
    pod: Object
    node: str
    reason: str


def _refusal(case: Refused) -> Iterator[str]:
    judge = next((judge for form, judge in _REASONS.items() if re.search(form, case.reason)), None)
    if judge is None:
        yield "no judge knows this reason"
    else:
        yield from judge(case)


def _too_far(case: Refused) -> Iterator[str]:
    found = re.fullmatch(_PAIR, case.reason)
    if not found:
        yield "has no number, no other end or no budget"
        return
    ms, peers, budget_ms = float(found[1]), found[2].split(" or "), float(found[3])
    now = datetime.now(UTC)
    if not ms > budget_ms:
        yield f"{ms} is not more than {budget_ms}"
    own = case.screen.component(case.row["component"]).get("policies", {}).get("latencyBudget")
    ends: set[str] = {"@robot"} if own and parse_us(own) == budget_ms * 1000 else set()
    for edge in case.screen.edges_of(case.row["component"]):
        if edge.get("latency") and parse_us(edge["latency"]["budget"]) == budget_ms * 1000:
            ends.add(edge["to"] if edge["from"] == case.row["component"] else edge["from"])
    if not ends:
        yield f"no budget of it is {budget_ms} ms"
    for peer in peers:
        there = [end for end in ends if _is_place_of(case.screen, case.history, end, peer)]
        if not there:
            yield f"{peer} is not where {ends} are"
        told = [key[3] for key in case.history.facts("rtt", case.node, peer, ..., until=now)]
        measured = [each for each in told if each is not None]
        if "about " in case.reason and measured:
            yield f"estimated, but {measured} ms were measured"
        if "about " not in case.reason and not any(abs(each - ms) <= max(0.05, 1e-3 * each) for each in measured):
            yield f"between {case.node} and {peer} {measured} ms were measured"


def _is_place_of(screen: Screen, history: History, end: str, node: str) -> bool:
    """Where the end was, or could be: a pod that is placed before its peer must leave that a place in reach."""
    now = datetime.now(UTC)
    if end == "@robot":
        return history.ever("robot", ..., node, until=now)
    waiting = [pod for pod in screen.pods_of(end) if not pod["spec"].get("nodeName")]
    could = node in screen.nodes and any(admits(pod, screen.nodes[node]) for pod in waiting)
    tied = screen.component(end).get("runsOn") == ["Robot"] and history.ever("robot", ..., node, until=now)
    return could or tied or history.ever("pod", end, node, until=now)


def _unreachable(case: Refused) -> Iterator[str]:
    if not case.history.ever("rtt", case.node, ..., None, until=datetime.now(UTC)):
        yield "all probes were answered"


def _insufficient(case: Refused) -> Iterator[str]:
    """The free amount is what is allocatable less what pods there request, and less than what is wanted."""
    found = re.fullmatch(r"Insufficient (cpu|memory), ([\d.]+)( [GM]iB)? free", case.reason)
    if not found:
        yield "names no resource and number"
        return
    resource, unit = found[1], {" GiB": 2**30, " MiB": 2**20}.get(found[3] or "", 1)
    free = float(found[2]) * unit
    has = float(_amount(case.screen.nodes[case.node]["status"]["allocatable"][resource]))
    used = sum(_requested(each, resource) for each in case.screen.pods_on(case.node))
    slack = 0.06 * unit + 0.001
    if not has - used - slack <= free <= has + slack:
        yield f"{has - used:g} to {has:g} are free"
    if _requested(case.pod, resource) <= free - slack:
        yield f"it wants {_requested(case.pod, resource):g}"


def _amount(quantity: str | int) -> float:
    return parse_milli(quantity) / 1000


def _requested(pod: Object, resource: str) -> float:
    wanted = (each.get("resources", {}).get("requests", {}).get(resource) for each in pod["spec"]["containers"])
    return float(sum(_amount(amount) for amount in wanted if amount is not None))


def _does_not_match(case: Refused) -> Iterator[str]:
    if case.node in case.screen.nodes and admits(case.pod, case.screen.nodes[case.node]):
        yield f"{case.node} matches its node selector and affinity"


def _unschedulable(case: Refused) -> Iterator[str]:
    if not case.history.ever("cordoned", case.node, until=datetime.now(UTC)):
        yield f"{case.node} takes pods"


def _tainted(case: Refused) -> Iterator[str]:
    if not case.history.ever("taint", case.node, ..., until=datetime.now(UTC)):
        yield f"{case.node} has no taint"


def _later_tier(case: Refused) -> Iterator[str]:
    found = re.search(r"of (?:tier (\w+)|no tier in runsOn), and (\w+) comes first in runsOn", case.reason)
    if not found or (found[1] and case.screen.tier(case.node) != found[1].lower()):
        yield f"{case.node} is of tier {case.screen.tier(case.node)}"
    elif case.row["node"] and case.screen.tier(case.row["node"]) != found[2].lower():
        yield f"it runs on tier {case.screen.tier(case.row['node'])}"


def _no_device(case: Refused) -> Iterator[str]:
    """Where a device of the type is present, somebody holds it, or it is of another model."""
    wishes = case.screen.component(case.row["component"]).get("devices", ())
    for device in (case.screen.telemetry.get(case.node) or {}).get("status", {}).get("devices", ()):
        alike = [
            wish
            for wish in wishes
            if wish["type"] == device["type"] and wish.get("model", "") in ("", device.get("model", ""))
        ]
        taken = case.history.facts("claim", ..., f"{device['id']} on {case.node}", until=datetime.now(UTC))
        gone = case.history.ever("device", case.node, device["id"], False, until=datetime.now(UTC))
        if alike and device["present"] and not taken and not gone:
            yield f"{device['id']} on {case.node} is free"


def _no_hardware(case: Refused) -> Iterator[str]:
    parts = case.screen.component(case.row["component"])
    wishes = [*parts.get("requires", ()), *parts.get("devices", ())]
    present = (case.screen.telemetry.get(case.node) or {}).get("status", {}).get("devices", ())
    types = {(device["type"], device.get("model", "")) for device in present if device["present"]}
    if all(
        any(wish["type"] == kind and wish.get("model", "") in ("", model) for kind, model in types) for wish in wishes
    ):
        yield f"{case.node} has {types}"


def _no_room_on_link(case: Refused) -> Iterator[str]:
    wanted = max(
        (_amount(edge["bandwidth"]) for edge in case.screen.edges_of(case.row["component"]) if edge.get("bandwidth")),
        default=0,
    )
    links = [_amount(text) for name in case.screen.nodes if (text := _link(case.screen, name))]
    if not wanted or not any(link < 2 * wanted for link in links):
        yield f"{wanted} of links with {links}"
    ends = {case.node, *(key[2] for key in case.history.facts("pod", ..., ..., until=datetime.now(UTC)))}
    if not any(_link(case.screen, name) for name in ends):
        yield f"no link of {ends} is limited"


def _link(screen: Screen, node: str) -> str:
    return (
        str(screen.nodes[node]["metadata"].get("annotations", {}).get(Annotation.LINK_BANDWIDTH, ""))
        if node in screen.nodes
        else ""
    )


def _apart(case: Refused) -> Iterator[str]:
    others = case.screen.partners(case.row["component"], "separateFrom")
    if not any(_is_place_of(case.screen, case.history, other, case.node) for other in others):
        yield f"none of {others} was on {case.node}"


def _beside(case: Refused) -> Iterator[str]:
    others = case.screen.partners(case.row["component"], "colocateWith")
    if not others or all(_is_place_of(case.screen, case.history, other, case.node) for other in others):
        yield f"{others} were on {case.node}"


_Judge = Callable[[Refused], Iterator[str]]
_REASONS: Final[Mapping[str, _Judge]] = {
    r" ms to | ms, exceeded": _too_far,
    r"got no answer": _unreachable,
    r"^Insufficient": _insufficient,
    r"didn't match Pod's node affinity/selector": _does_not_match,
    r"were unschedulable": _unschedulable,
    r"had untolerated taint": _tainted,
    r"comes first in runsOn": _later_tier,
    r"had no free device for the pod": _no_device,
    r"didn't have the required hardware": _no_hardware,
    r"left too little bandwidth": _no_room_on_link,
    r"ran a component the pod must be separate from": _apart,
    r"didn't run a pod that this one must share its node with": _beside,
}


# Tiers, plans and edges


def _tier(screen: Screen, row: Object) -> Iterator[str]:
    if not row["tier"] or not row["node"]:
        return
    runs_on, here = screen.component(row["component"]).get("runsOn", []), screen.tier(row["node"])
    if first := re.match(r"tier (\w+) comes first in runsOn", row["tier"]):
        if runs_on[:1] != [first[1]] or here != first[1].lower():
            yield f"{row['tier']}: it runs on tier {here} of {runs_on}"
    elif following := re.match(r"no node of tier (.+) was feasible: tier (\w+) is next in runsOn", row["tier"]):
        before = following[1].split(" or ")
        if runs_on[: len(before) + 1] != [*before, following[2]] or here != following[2].lower():
            yield f"{row['tier']}: it runs on tier {here} of {runs_on}"
    elif not re.match(r"tier \w+: a node of tier \w+ was feasible for this pod, but not in the plan", row["tier"]):
        yield f"no judge knows this: {row['tier']}"


def _plan(screen: Screen, history: History, view: Object) -> Iterator[str]:
    """`no plan was better` while no other places serve every budget of the instance clearly better."""
    rows = {
        row["component"]: row for row in view["components"] if row["node"] and row["component"] in screen.components
    }
    texts = {row["planned"] for row in rows.values() if row["planned"]}
    for text in texts:
        if not re.match(r"planned together with its group; |.*: placed one by one", text):
            yield f"no judge knows this: {text}"
    budgets = [edge for edge in screen.app["spec"].get("edges", ()) if edge.get("latency")]
    alone = {pod["metadata"]["labels"].get(Label.COMPONENT) for pod in screen.pods if is_component(pod)}
    if not any("no plan was better" in text for text in texts) or not budgets or set(rows) != alone or len(rows) > 3:
        return
    if any("no plan was better" not in row["planned"] for row in rows.values()):
        return
    then = {name: row["node"] for name, row in rows.items()}
    uses = _uses(history, budgets, then)
    choices = [_candidates(screen, row) for row in rows.values()]
    for nodes in product(*choices):
        other = _uses(history, budgets, dict(zip(rows, nodes, strict=True)))
        if uses and other and all(there <= here - CLEARLY for here, there in zip(uses, other, strict=True)):
            yield f"no plan was better than {then}, but {dict(zip(rows, nodes, strict=True))} was: {other} of the budgets, not {uses}"
            return


def _candidates(screen: Screen, row: Object) -> list[str]:
    """Nodes that were not refused then: those with scores."""
    return [name for name in row["scores"] if name in screen.nodes and node_ready(screen.nodes[name])]


def _uses(history: History, edges: Sequence[Object], where: Mapping[str, str]) -> list[float]:
    """How much of each budget is used, by what was measured first; empty where an end or a time is not known."""
    found = []
    for edge in edges:
        ends = [where.get(edge["from"], ""), where.get(edge["to"], "")]
        if not all(ends):
            return []
        told = [key[3] for key in history.facts("rtt", *ends, ..., until=datetime.now(UTC))]
        ms = 0.05 if ends[0] == ends[1] else told[0] if told else None
        if ms is None:
            return []
        found.append(1000 * ms / parse_us(edge["latency"]["budget"]))
    return found


def _edge(screen: Screen, history: History, edge: Object) -> Iterator[str]:
    spec = next((each for each in screen.app["spec"].get("edges", ()) if _key(each) == _key(edge)), None)
    if spec is None:
        yield "there is no such edge"
        return
    latency = spec.get("latency", {})
    if edge.get("budget") != latency.get("budget") or (
        latency and edge.get("percentile") != latency.get("percentile", 95)
    ):
        yield f"its budget is {latency}"
    nodes = edge.get("nodes", [])
    for end, node in zip((edge["from"], edge["to"]), nodes if len(nodes) == 2 else (), strict=False):
        places = screen.robot_nodes if end == "@robot" else screen.nodes_of(end)
        if node not in places:
            yield f"{end} is on {places}"
    now = datetime.now(UTC)
    told = screen.reported(*nodes) if len(nodes) == 2 else []
    if edge.get("measured"):
        yield from _measured(history, edge, nodes, told, now)
    elif len(nodes) == 2 and nodes[0] != nodes[1] and told and not edge.get("p95"):
        yield f"it is not known, but {told} is measured"
    if edge.get("estimated") and told:
        yield f"estimated, but {told} is measured"


def _measured(
    history: History, edge: Object, nodes: Sequence[str], told: Sequence[Any], now: datetime
) -> Iterator[str]:
    p95 = parse_us(edge["p95"]) / 1000 if edge.get("p95") else None
    if not history.was("rtt", *nodes, p95, at=now, within_s=90):
        yield f"nobody measured {p95} ms between {nodes} within the last minute"
    newest, worst = edge.get("newest"), max((each[1] for each in told), default=None)
    if newest is None and told and p95 is not None and abs(p95 - worst) >= SAME * p95:
        yield f"{worst} ms are measured now"
    if newest == "unreachable" and worst != float("inf"):
        yield f"{worst} ms are measured now"
    if newest and (number := re.search(r"([\d.]+) ms", newest)):
        values = {each for pair in told for each in pair}
        if not any(abs(float(number[1]) - each) <= 0.01 * each + 0.01 for each in values):
            yield f"{told} ms are measured now"


def _key(edge: Object) -> tuple[str, str, str, str]:
    return edge.get("kind", "Topic"), edge["topic"], edge["from"], edge["to"]
