"""`explain`: where each component runs, why there, and which nodes were refused."""

from collections import defaultdict
from collections.abc import Collection
from dataclasses import dataclass
from typing import Final

import msgspec

from robotapp_api.model.names import SYSTEM_NAMESPACE, Condition, Label, Reason
from robotapp_api.values.placement.explanation import (
    describe_hardware,
    describe_refusals,
    describe_waiting,
    list_budgets,
)
from robotapp_api.values.replicas import list_replicas, names_of
from robotapp_cli.commands.apps import print_edges, with_percentiles
from robotapp_cli.commands.reasons import with_what_is_known
from robotapp_cli.failures import CliError, Exit
from robotapp_cli.output import Column, Output, blank_line, name_repeated, print_line, print_table, write_structured
from robotapp_cli.reading.fields import Json, condition, label, meta, status
from robotapp_cli.reading.instances import Instance, chosen, in_full, instances_of, name_instance_kind
from robotapp_cli.reading.scheduler_link import Link, connect
from robotapp_cli.reading.session import Session
from robotapp_client.api.resources import PODS, ROBOTAPPS

_BEFORE_PODS: Final = (Condition.ACCEPTED, Condition.ALLOCATED, Condition.READY)
"""What keeps pods from being made, first things first."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Question:
    """What the user asked about."""

    name: str
    component: str | None = None
    robot: str | None = None
    scheduler_url: str | None = None
    scheduler_namespace: str = SYSTEM_NAMESPACE


class Row(msgspec.Struct, rename="camel"):
    """One pod, or a component without one."""

    component: str
    pod: str = ""
    node: str = ""
    runner_up: str = ""
    reasons: list[str] = msgspec.field(default_factory=list)
    scores: dict[str, int] = msgspec.field(default_factory=dict)
    devices: list[str] = msgspec.field(default_factory=list)
    tier: str = ""
    """Why a node of this tier, where runsOn leaves a choice."""
    planned: str = ""
    """How the place was found together with those of the app's other pods."""
    recorded: bool = False
    """The reasons are the scheduler's record of its decision."""
    failing: bool = False
    """A discovery server, router or master of which the operator says why it is not ready."""
    recomputed: bool = False
    """The record is gone, and the scheduler has decided again to answer."""
    suspended: bool = False
    """It has no pod because it shall have none: `suspend` of the app, or `replicas: 0`."""
    ended: bool = False
    """It has no pod because its instance has ended with its jobs."""


class InstanceView(msgspec.Struct, rename="camel"):
    """One instance of the app."""

    robot: str
    domain: int | None
    components: list[Row]
    edges: list[Json]


async def show_explain(session: Session, question: Question) -> None:
    """Print the answer; the scheduler's records where they can be had, pod conditions otherwise."""
    app = await session.client.get(ROBOTAPPS, question.name, namespace=session.home)
    selector = f"{Label.APP_UID}={meta(app)['uid']}"
    pods = (await session.client.list(PODS, namespace=session.home, label_selector=selector)).items
    found = chosen(_with_pods(await instances_of(session, app), pods), question.robot, app=question.name)
    shown = in_full(found, everything=_everything(session, question)) or found[:1]
    async with connect(session, url=question.scheduler_url, namespace=question.scheduler_namespace) as link:
        views = [await _instance(app, pods, instance=each, question=question, link=link) for each in shown]
    note = "\n".join(filter(None, (note_of(link, views), _left_out(session, len(found) - len(shown), question.name))))
    if session.options.output.structured:
        instances = msgspec.to_builtins(views)
        source = "conditions" if link.problem or _missing(views) else "scheduler"
        write_structured(
            {"app": question.name, "namespace": session.home, "source": source, "note": note, "instances": instances},
            session.options.output,
        )
        return
    for view in views:
        _print(app, view, wide=session.options.output is Output.WIDE)
    if note:
        blank_line()
        print_line(note, style="yellow")


def _everything(session: Session, question: Question) -> bool:
    """Whether to show all instances, however many: each of their pods is asked about."""
    output = session.options.output
    return question.robot is not None or output.structured or output is Output.WIDE


def _left_out(session: Session, count: int, name: str) -> str:
    if not count:
        return ""
    command = session.write_command("explain", name, "--robot", "NAME")
    return f"{count} more instances are not shown: {command}; all of them: -o wide"


def _with_pods(found: list[Instance], pods: list[Json]) -> list[Instance]:
    """With an empty one for each instance that has pods but no object, because it is being made or was deleted."""
    known = {each.name for each in found}
    missing = {label(pod, Label.INSTANCE) for pod in pods} - known
    return [*found, *(Instance(name, {}) for name in sorted(missing))] or [Instance("", {})]


async def _instance(app: Json, pods: list[Json], *, instance: Instance, question: Question, link: Link) -> InstanceView:
    own = _by_component(pods, instance.name)
    nodes = {name: found[0]["spec"].get("nodeName", "") for name, found in own.items()}
    messages = {item["name"]: item.get("message", "") for item in instance.components}
    suspended = _list_suspended(app)
    rows: list[Row] = []
    records: dict[str, Json] = {}
    for name in _components(app, own, question):
        peers = list_budgets(app, name, instance=instance.name, nodes=nodes)
        for pod in own.get(name, []):
            record = await link.fetch(meta(pod)["namespace"], meta(pod)["name"])
            if record:
                records[name] = record
            reasons = describe_refusals(record, peers, hardware=describe_hardware(app, name)) if record else []
            row = _row(name, pod, record, reasons)
            if not row.node and (device := _missing_device(app, instance, name)):
                row.reasons = [device, *row.reasons]
            if trouble := _helper_trouble(instance, pod):
                row.reasons = [trouble, *row.reasons]
                row.failing = True
            rows.append(row)
        if name not in own:
            reasons = [messages.get(name) or _why_none(app, instance)]
            has_ended = "completionTime" in instance.observed
            rows.append(Row(name, reasons=reasons, suspended=name in suspended, ended=has_ended))
    edges = with_percentiles(app, instance.edges)
    edges = [edge for edge in edges if question.component in (None, edge["from"], edge["to"])]
    return InstanceView(instance.name, instance.domain, rows, with_what_is_known(edges, records))


def _list_suspended(app: Json) -> set[str]:
    """Returns the names of the components that shall have no pods."""
    components, suspends = app["spec"]["components"], app["spec"].get("suspend", False)
    return {item["name"] for item in components if suspends or item.get("replicas") == 0}


def _helper_trouble(instance: Instance, pod: Json) -> str:
    """Returns what the operator observes of a discovery server, router or master that fails, "" for any other pod."""
    role, number = label(pod, Label.ROLE), label(pod, Label.PART)
    name = f"{role}-{number}" if number else role
    helpers = instance.observed.get("helpers") or ()
    return next((str(helper.get("message", "")) for helper in helpers if role and helper.get("name") == name), "")


def _missing_device(app: Json, instance: Instance, component: str) -> str:
    """Returns what the operator observes of a device that no node has for the component, or that the driver of its node refuses."""
    for obj in (instance.obj, app):
        found = condition(obj, Condition.ALLOCATED)
        message = str(found.get("message") or "").removeprefix(f"{instance.name}: ")
        if found.get("reason") == Reason.WAITING_FOR_DEVICES and message.startswith(f"{component} ("):
            return message
    return ""


def _why_none(app: Json, instance: Instance) -> str:
    """Why a component has no pod: what the operator says of the instance or of the app, if it is no matter of the scheduler."""
    for kind in _BEFORE_PODS:
        for obj in (instance.obj, app):
            found = condition(obj, kind)
            if found.get("status") == "False":
                return f"no pod yet: {found.get('message') or found.get('reason', '')}"
    if not status(app).get("conditions"):
        return "no pod yet: the operator has not seen the app; does it run? kubectl get deployments -A -l app.kubernetes.io/component=operator"
    return "no pod yet"


def _by_component(pods: list[Json], robot: str) -> dict[str, list[Json]]:
    """The pods of one instance in the order of their names; those of no component under a name of their own."""
    found = defaultdict(list)
    for pod in sorted(pods, key=lambda pod: str(meta(pod)["name"])):
        if label(pod, Label.INSTANCE) == robot:
            found[label(pod, Label.COMPONENT) or _infrastructure(pod)].append(pod)
    return dict(found)


def _components(app: Json, own: Collection[str], question: Question) -> list[str]:
    """Which to show: the one that was asked for, else those of the app, then what else it runs."""
    written = app["spec"]["components"]
    replicas = list_replicas(written)
    names = [name for item in written for name in names_of(item["name"], replicas)]
    if not question.component:
        return [*names, *sorted(set(own) - set(names))]
    if question.component in names or question.component in replicas:
        return list(names_of(question.component, replicas))
    text = f"{question.name} has no component {question.component}; it has: {', '.join(names)}"
    raise CliError(text, code=Exit.NOT_FOUND)


def _infrastructure(pod: Json) -> str:
    """Name of a pod that belongs to the app but to none of its components: a discovery server."""
    return f"({label(pod, Label.NAME) or 'other'})"


def _row(component: str, pod: Json, record: Json | None, reasons: list[str]) -> Row:
    node = str(pod["spec"].get("nodeName") or "")
    row = Row(component, pod=str(meta(pod)["name"]), node=node, reasons=reasons, recorded=record is not None)
    if record:
        top = record.get("top") or {}
        row.runner_up = record.get("runnerUp") or ""
        row.scores = dict(zip(top.get("nodes") or [], top.get("totals") or [], strict=False))
        row.devices = list(record.get("devices") or [])
        row.tier = str(record.get("tier") or "")
        row.planned = str(record.get("planned") or "")
        row.recomputed = bool(record.get("recomputed"))
    if not node:
        told = str(condition(pod, "PodScheduled").get("message") or "the scheduler has not looked at it yet")
        row.reasons = [*describe_waiting(record, condition(pod, "PodScheduled")), *reasons] or [told]
    return row


def note_of(link: Link, views: list[InstanceView]) -> str:
    if link.problem:
        return (
            f"The scheduler's records could not be read: {link.problem}.\n"
            "Shown are pod conditions, without the nodes refused. --scheduler-url (or ROBOTAPP_SCHEDULER_URL) says where the scheduler listens."
        )
    again = dict.fromkeys(row.component for view in views for row in view.components if row.recomputed)
    notes = []
    if again:
        notes.append(f"No decision is on record of: {', '.join(again)}. Shown is what the scheduler would decide now.")
    if missing := dict.fromkeys(_missing(views)):
        notes.append(f"The scheduler has no record (any more) of: {', '.join(missing)}.")
    return "\n".join(notes)


def _missing(views: list[InstanceView]) -> list[str]:
    """Components with a pod the scheduler says nothing about; infrastructure is not its business to explain."""
    return [
        row.component
        for view in views
        for row in view.components
        if row.pod and not row.recorded and not row.component.startswith("(")
    ]


def _describe_place(row: Row) -> str:
    """Returns why a component is on no node."""
    if row.ended:
        return "ended"
    return "suspended" if row.suspended else "waiting"


def _print(app: Json, view: InstanceView, *, wide: bool) -> None:
    title = [f"{meta(app)['namespace']}/{meta(app)['name']}"]
    title += [f"{name_instance_kind(app)} {view.robot}"] if view.robot else []
    title += [f"domain {view.domain}"] if view.domain is not None else []
    print_line(", ".join(title), style="bold")
    shown = [row for row in view.components if wide or row.failing or not row.component.startswith("(")]
    columns = [Column("COMPONENT"), Column("NODE"), Column("RUNNER-UP"), Column("NODES REFUSED", wraps=True)]
    reasons = name_repeated([row.component for row in shown], ["\n".join(row.reasons) for row in shown])
    rows = [
        [row.component, row.node or _describe_place(row), row.runner_up, text]
        for row, text in zip(shown, reasons, strict=True)
    ]
    if wide:
        columns.append(Column("SCORES", wraps=True))
        rows = [
            [*cells, ", ".join(f"{node} {total}" for node, total in row.scores.items())]
            for cells, row in zip(rows, shown, strict=True)
        ]
    print_table(columns, rows, indent=2)
    for row in shown:
        if row.tier:
            print_line(f"  {row.component}: {row.tier}")
    for text in dict.fromkeys(row.planned for row in shown if row.planned):
        print_line(f"  {text}")
    print_edges(view.edges)
