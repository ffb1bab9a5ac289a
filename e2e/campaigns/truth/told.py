"""The judge of events and of the conditions that say the same: names, nodes and numbers must have been so at that time."""

import re
from collections.abc import Callable, Iterator, Mapping
from datetime import UTC, datetime
from typing import Final

from campaigns.rigs.simulated_site import Object
from campaigns.truth.history import History
from campaigns.truth.screen import Screen
from robotapp_api.values.quantities.duration import parse_us

ABOUT_S: Final = 90.0
"""A status follows figures once a minute at most, so what it tells may be as old."""
_TIME: Final = r"([\d.]+(?:us|ms|s|m)|unreachable|\?|unknown)"
_EDGE: Final = rf"(\S+) (\S+) -> (\S+) {_TIME} of {_TIME}"
Judge = Callable[[Screen, History, str, datetime], Iterator[str]]
MatchJudge = Callable[[Screen, History, re.Match[str], datetime], Iterator[str]]


def of_form(pattern: str, otherwise: str = "not of the form of such a sentence") -> Callable[[MatchJudge], Judge]:
    """Makes a judge of texts from one of matches; a text that does not begin with the pattern is wrong for that alone."""

    def decorate(judge: MatchJudge) -> Judge:
        def judge_text(screen: Screen, history: History, note: str, at: datetime) -> Iterator[str]:
            if match := re.match(pattern, note, re.DOTALL):
                yield from judge(screen, history, match, at)
            else:
                yield otherwise

        return judge_text

    return decorate


def false_events(screen: Screen, history: History) -> Iterator[str]:
    """What events and conditions tell that was not so."""
    for event in screen.events:
        judge = _EVENTS.get(event["reason"])
        if judge is None:
            yield f"event {event['reason']}: no judge knows it: {event['note']}"
            continue
        for text in judge(screen, history, event["note"], _time(event)):
            yield f"event {event['reason']} ({event['note']}): {text}"
    for event in screen.pod_events:
        for text in _pod_event(screen, history, event):
            yield f"event {event['reason']} of a pod ({event['note']}): {text}"
    for condition in screen.status["conditions"]:
        judge = _CONDITIONS.get((condition["type"], condition["reason"]))
        for text in judge(screen, history, condition["message"], datetime.now(UTC)) if judge else ():
            yield f"{condition['type']} ({condition['message']}): {text}"


def _time(event: Object) -> datetime:
    return datetime.fromisoformat(event["eventTime"])


def _any(screen: Screen, history: History, note: str, at: datetime) -> Iterator[str]:
    """Its text is that of a condition, whose judge is another one."""
    del screen, history, note, at
    yield from ()


def _domain(screen: Screen, history: History, note: str, at: datetime) -> Iterator[str]:
    found = re.fullmatch(r"(?:robot (\S+): )?domain (\d+)", note)
    if not found:
        yield "not of the form of such an event"
    elif not history.ever("claim", ... if _shares(screen) else screen.name, int(found[2]), until=at):
        yield f"nobody held {found[2]}" if _shares(screen) else f"{screen.name} never held {found[2]}"


def _shares(screen: Screen) -> bool:
    return bool((screen.app["spec"].get("ros2") or {}).get("shareWith"))


@of_form(r"(\d+) of (\d+) components? on ([^;]+)")
def _placed(screen: Screen, history: History, match: re.Match[str], at: datetime) -> Iterator[str]:
    if match[1] != match[2] or int(match[2]) % len(screen.app["spec"]["components"]):
        yield f"{match[1]} of {match[2]} is no number of whole instances"
    for node in match[3].split(", "):
        if not history.was("pod", ..., node, at=at, within_s=5):
            yield f"no pod was on {node}"
    yield from _given_up(screen, history, match.string, at)


def _given_up(screen: Screen, history: History, note: str, at: datetime) -> Iterator[str]:
    for component, tier in re.findall(r"(\S+) runs on tier (\w+) instead of", note):
        where = [key[2] for key in history.facts("pod", component, ..., until=at)]
        if not any(screen.tier(node) == tier.lower() for node in where):
            yield f"{component} was on {where}, none of tier {tier}"
    form = rf"(\S+) between (\S+) and (\S+) (?:takes|is) {_TIME} \((\w+), (\S+) to (\S+)\) instead of {_TIME}"
    for topic, one, other, time, source, here, there, budget in re.findall(form, note):
        yield from _figure(history, (here, there), time, at, measured=source == "measured")
        if parse_us(budget) not in _budgets(screen, topic):
            yield f"{topic} has no budget of {budget}"
        if not history.ever("pod", one, here, until=at):
            yield f"{one} was never on {here} (the other end: {other})"


@of_form(r"(\d+) of (\d+) placed; (?:(\S+): )?(\S+): (.*)")
def _rejected(screen: Screen, history: History, match: re.Match[str], at: datetime) -> Iterator[str]:
    if match[4] not in screen.components:
        yield f"there is no component {match[4]}"
    yield from _counts_of_nodes(screen, history, match[5], at)


def _counts_of_nodes(screen: Screen, history: History, text: str, at: datetime) -> Iterator[str]:
    """`0/6 nodes are available: 2 Insufficient cpu, 4 node(s) …`."""
    found = re.search(r"(\d+)/(\d+) nodes are available: (.*)", text, re.DOTALL)
    if not found:
        return
    total, counts = int(found[2]), [int(count) for count in re.findall(r"(\d+) (?=Insufficient|node\(s\))", found[3])]
    nodes = len(history.facts("node", ..., until=at))
    if total > nodes or (total != nodes and len(screen.nodes) == nodes):
        yield f"there were {nodes} nodes"
    if counts and (sum(counts) < total or max(counts) > total):
        yield f"the reasons are about {counts} nodes, not about {total}"


@of_form(rf"(\d+) of (\d+) edges? (?:is|are) over budget, worst {_EDGE}; (.*)")
def _over(screen: Screen, history: History, match: re.Match[str], at: datetime) -> Iterator[str]:
    over, count, topic, one, other, time, budget, advice = match.groups()
    edges = [edge for edge in screen.app["spec"].get("edges", ()) if edge.get("latency")]
    if int(over) > int(count) or int(count) % len(edges):
        yield f"{len(edges)} edges have a budget"
    if parse_us(budget) not in _budgets(screen, topic):
        yield f"{topic} has no budget of {budget}"
    if not any(_was(history, pair, time, at) for pair in _pairs(history, one, other, at)):
        yield f"nobody measured {time} between {one} and {other}"
    yield from _stays(screen, history, advice, at)


def _stays(screen: Screen, history: History, text: str, at: datetime) -> Iterator[str]:
    """Why nothing is moved."""
    limits = screen.app["spec"].get("placement", {}).get("reschedule", {})
    for component, time, node in re.findall(rf"(\S+) would have {_TIME} on ([a-z0-9-]+)", text):
        if not history.ever("node", node, until=at):
            yield f"there is no node {node}"
        if history.was("pod", component, node, at=at) and len(history.facts("pod", component, ..., until=at)) == 1:
            yield f"{component} is on {node}"
        ends = [edge["to"] if edge["from"] == component else edge["from"] for edge in screen.edges_of(component)]
        pairs = [pair for end in ends for pair in _pairs(history, node, end, at)]
        if not any(_was(history, pair, time, at) for pair in pairs):
            yield f"nobody measured {time} between {node} and {ends}"
    if "placement.reschedule.when is Never" in text and limits.get("when", "Never") != "Never":
        yield f"placement.reschedule is {limits}"
    if "no other node has such a device" in text and limits.get("when") == "":
        yield "never"
    for when, until in re.findall(r"it was moved at (\S+) \(placement.reschedule.cooldown, until (\S+)\)", text):
        pause_us = 1e6 * (datetime.fromisoformat(until) - datetime.fromisoformat(when)).total_seconds()
        if abs(pause_us - parse_us(limits.get("cooldown", "2m"))) > 1e6:
            yield f"placement.reschedule is {limits}"
        if datetime.fromisoformat(until) < at and (datetime.now(UTC) - at).total_seconds() < 1:
            yield f"{until} is over"
    for count in re.findall(r"it was moved (\d+) times within 24 hours", text):
        if int(count) < int(limits.get("maxPerDay", 3)):
            yield f"placement.reschedule is {limits}"
    if "maxPerDay is 0" in text and limits.get("maxPerDay") != 0:
        yield f"placement.reschedule is {limits}"


@of_form(rf"(\d+) of (\d+) edges? (?:is|are) within budget, tightest {_EDGE}")
def _within(screen: Screen, history: History, match: re.Match[str], at: datetime) -> Iterator[str]:
    _, _, topic, one, other, time, budget = match.groups()
    if parse_us(budget) not in _budgets(screen, topic):
        yield f"{topic} has no budget of {budget}"
    pairs = _pairs(history, one, other, at)
    if not any(_was(history, pair, time, at) or pair[0] == pair[1] for pair in pairs):
        yield f"nobody measured {time} between {one} and {other}"


def _moved(screen: Screen, history: History, note: str, at: datetime) -> Iterator[str]:
    found = re.match(r"(\S+) moved from (\S+) to (\S+)(?: \((\S+) was proposed\))?: (.*)", note)
    back = re.match(r"(\S+) was evicted from (\S+) and came back, (\S+) was proposed: (.*)", note)
    if not found and not back:
        yield "not of the form of such an event"
        return
    component, here = (found or back or ["", "", ""])[1], (found or back or ["", "", ""])[2]
    there = found[3] if found else here
    for node in (here, there):
        if not history.ever("pod", component, node, until=at):
            yield f"{component} was never on {node}"
    if not history.was("pod", component, there, at=at):
        yield f"{component} was not on {there}"
    why = found[5] if found else back[4] if back else ""
    if lost := re.fullmatch(r"device (\S+) on (\S+) is lost", why):
        if not history.ever("device", lost[2], lost[1], False, until=at):
            yield f"{lost[1]} was there"
    elif edge := re.match(rf"{_EDGE} before, {_TIME} expected", why):
        topic, one, other, before, budget, expected = edge.groups()
        if parse_us(budget) not in _budgets(screen, topic):
            yield f"{topic} has no budget of {budget}"
        peers = [key[2] for key in history.facts("pod", other if component == one else one, ..., until=at)]
        peers += screen.robot_nodes if "@robot" in (one, other) else []
        for node, time in ((here, before), (found[4] or there if found else here, expected)):
            if not any(_was(history, (node, peer), time, at) for peer in peers):
                yield f"nobody measured {time} between {node} and {peers}"
    else:
        yield f"the reason is not known to the judge: {why}"


@of_form(r"(?:(\S+): )?(\S+): device (\S+) on (\S+?)(?: and (\d+) more devices)? is gone")
def _lost(screen: Screen, history: History, match: re.Match[str], at: datetime) -> Iterator[str]:
    if match[2] not in screen.components:
        yield f"there is no component {match[2]}"
    if not history.was("device", match[4], match[3], False, at=at, within_s=5):
        yield f"{match[3]} was there"
    if not history.ever("claim", screen.name, f"{match[3]} on {match[4]}", until=at):
        yield f"{screen.name} never held it"
    for edge in re.findall(r"would have|over budget", match.string):
        yield f"{edge} is no matter of a device"
    yield from _stays(screen, history, match.string, at)


def _claimed(screen: Screen, history: History, note: str, at: datetime) -> Iterator[str]:
    found = re.search(r"(\d+) of (\d+) devices?", note)
    if not found or found[1] != found[2]:
        yield "tells of no device, or not of all"
        return
    wished = [device for part in screen.app["spec"]["components"] for device in part.get("devices") or ()]
    things = {key[2] for key in history.facts("claim", screen.name, ..., until=at) if isinstance(key[2], str)}
    # What is shared has no claim of its own that stays.
    if all(device.get("sharing", "Exclusive") == "Exclusive" for device in wished) and len(things) < int(found[1]):
        yield f"{screen.name} had only held {sorted(things)}"


@of_form(r"device (\S+) on (\S+) is back: ", "not of the form of such an event")
def _returned(screen: Screen, history: History, match: re.Match[str], at: datetime) -> Iterator[str]:
    if not history.was("device", match[2], match[1], True, at=at):
        yield "it was not there"
    if not history.was("claim", screen.name, f"{match[1]} on {match[2]}", at=at, within_s=5):
        yield f"{screen.name} did not hold it"


@of_form(r".*?device (\S+) on (\S+) is held by (\S+?)(?: \(([^)]+)\))?(?::|;|$)", "names no device and holder")
def _busy(screen: Screen, history: History, match: re.Match[str], at: datetime) -> Iterator[str]:
    holder = match[3] if "/" in match[3] else ...
    if not history.was("claim", holder, f"{match[1]} on {match[2]}", at=at, within_s=5):
        yield f"{match[3]} did not hold {match[1]} on {match[2]}"
    if holder == screen.name:
        yield "that is the app itself"


def _robot(screen: Screen, history: History, note: str, at: datetime) -> Iterator[str]:
    if found := re.search(r"node (\S+) of the robot is not Ready(?: since (\S+?))?[:,; ]", note):
        if not history.was("ready", found[1], False, at=at, within_s=5):
            yield f"{found[1]} was Ready"
        if not history.ever("robot", ..., found[1], until=at):
            yield f"{found[1]} is no robot's"
    elif found := re.search(r"robot (\S+) is out of sight", note):
        if history.was("robot", found[1], ..., at=at) and screen.robot_is_there(found[1]):
            yield f"there was a node of {found[1]}"
    else:
        yield "names no node and no robot"


def _pod_event(screen: Screen, history: History, event: Object) -> Iterator[str]:
    """Judges the scheduler's events. Those of kube-controller-manager, which a late node causes, have no eventTime."""
    note = event["note"]
    match event["reason"]:
        case "Scheduled":
            found = re.match(r"Successfully assigned (\S+?)/(\S+) to ([a-z0-9.-]+)", note)
            if not found or not history.ever("uid", event["regarding"]["uid"], found[3], until=_time(event)):
                yield "it was not on that node"
        case "FailedScheduling":
            yield from _counts_of_nodes(screen, history, note, _time(event))
        case "DeviceBusy":
            yield from _busy(screen, history, note, _time(event))


# Numbers


def _budgets(screen: Screen, topic: str) -> set[int]:
    edges = [edge for edge in screen.app["spec"].get("edges", ()) if edge["topic"] == topic and edge.get("latency")]
    return {parse_us(edge["latency"]["budget"]) for edge in edges}


def _pairs(history: History, one: str, other: str, at: datetime) -> list[tuple[str, str]]:
    """Nodes on which both ends were. An end is a component, `@robot` or a node itself."""

    def nodes(end: str) -> list[str]:
        if end == "@robot":
            return [key[2] for key in history.facts("robot", ..., ..., until=at)]
        found = [key[2] for key in history.facts("pod", end, ..., until=at)]
        return found or [end]

    return [(here, there) for here in nodes(one) for there in nodes(other)]


def _was(history: History, pair: tuple[str, str], time: str, at: datetime) -> bool:
    """Was this the time between two nodes, within the last minute and what it takes to write?"""
    if time in ("?", "unknown"):
        return True
    ms = None if time == "unreachable" else parse_us(time) / 1000
    return history.was("rtt", *pair, ms, at=at, within_s=ABOUT_S)


def _figure(history: History, pair: tuple[str, str], time: str, at: datetime, *, measured: bool) -> Iterator[str]:
    if measured and not _was(history, pair, time, at):
        yield f"nobody measured {time} between {' and '.join(pair)}"


_EVENTS: Final[Mapping[str, Judge]] = {
    "DomainAllocated": _domain,
    "Placed": _placed,
    "FallbackUsed": _placed,
    "NodeRejected": _rejected,
    "BudgetExceeded": _over,
    "Rescheduled": _moved,
    "DeviceClaimed": _claimed,
    "DeviceLost": _lost,
    "DeviceReturned": _returned,
    "DeviceBusy": _busy,
    "RobotNotReady": _robot,
    "RobotOffline": _robot,
    **dict.fromkeys(
        (
            "InvalidSpec",
            "UnknownDistro",
            "NoMatchingRobot",
            "TooLarge",
            "DomainTaken",
            "DomainExhausted",
            "PoolNotFound",
            "PoolOverlaps",
            "QuotaExceeded",
            "ClaimConflict",
            "ChildFailed",
            "EolDistro",
        ),
        _any,
    ),
}
_CONDITIONS: Final[Mapping[tuple[str, str], Judge]] = {
    ("Placed", "Placed"): _placed,
    ("Placed", "FallbackUsed"): _placed,
    ("Placed", "Unschedulable"): _rejected,
    ("BudgetMet", "BudgetExceeded"): _over,
    ("BudgetMet", "WithinBudget"): _within,
    ("Allocated", "DeviceLost"): _lost,
    ("Allocated", "DeviceBusy"): _busy,
    ("Ready", "RobotOffline"): _robot,
    ("Ready", "RobotNotReady"): _robot,
}
