"""`list` and `info`: RobotApps as the operator sees them."""

from collections.abc import Iterator
from typing import Final

from robotapp_api.model.names import Condition, Phase
from robotapp_cli.output import (
    Column,
    Output,
    arrow,
    bar,
    blank_line,
    name_repeated,
    print_line,
    print_table,
    write_structured,
)
from robotapp_cli.reading.fields import Json, age, elapsed, meta, milliseconds, plain, short_ms, status
from robotapp_cli.reading.instances import Instance, chosen, in_full, instances_of, name_instance_kind
from robotapp_cli.reading.runs import has_ended
from robotapp_cli.reading.session import Session
from robotapp_client.api.resources import EVENTS, ROBOTAPPS

_EVENTS_SHOWN = 8
MEDIAN: Final = 50
_VERDICT: Final = {True: "met", False: "exceeded", None: ""}
# Progressing and Stalled say False when all is well.
_GOOD_WHEN_FALSE = frozenset({Condition.PROGRESSING, Condition.STALLED})


async def show_list(session: Session) -> None:
    """All RobotApps of the namespace, or of all namespaces."""
    listing = await session.client.list(ROBOTAPPS, namespace=session.namespace)
    apps = sorted(listing.items, key=lambda app: (meta(app)["namespace"], meta(app)["name"]))
    output = session.options.output
    if output.structured:
        write_structured({"apiVersion": "v1", "kind": "List", "items": [plain(app) for app in apps]}, output)
        return
    if not apps:
        where = f"namespace {session.namespace}" if session.namespace else "any namespace"
        print_line(f"No RobotApp in {where}. The smallest one: kubectl apply -f examples/minimal.yaml")
        return
    everywhere, wide = session.namespace is None, output is Output.WIDE
    columns = (["NAMESPACE"] if everywhere else []) + [
        "NAME",
        "READY",
        "PHASE",
        "DOMAIN",
        "ROBOTS",
        "BUDGET",
        "DEVICES",
        "AGE",
    ]
    extra: list[Column | str] = ["RMW", "DISCOVERY", "NODES", Column("MESSAGE", wraps=True)] if wide else []
    print_table([*columns, *extra], (_row(app, everywhere=everywhere, wide=wide) for app in apps))


def _row(app: Json, *, everywhere: bool, wide: bool) -> list[str]:
    summary = status(app).get("summary") or {}
    row = [meta(app)["namespace"]] if everywhere else []
    row += [meta(app)["name"], summary.get("ready", ""), status(app).get("phase", "")]
    row += [summary.get(key, "") for key in ("domain", "robots", "budget", "devices")]
    row.append(age(meta(app).get("creationTimestamp")))
    if wide:
        row += [summary.get(key, "") for key in ("rmw", "discovery", "nodes", "message")]
    return row


async def show_info(session: Session, name: str, robot: str | None = None) -> None:
    """One RobotApp: conditions, instances, edges, what happened."""
    app = await session.client.get(ROBOTAPPS, name, namespace=session.home)
    instances = chosen(await instances_of(session, app), robot, app=name)
    if session.options.output.structured:
        found = {"app": plain(app), "instances": [plain(each.obj) for each in instances]}
        write_structured(found, session.options.output)
        return
    listing = await session.client.list(
        EVENTS, namespace=session.home, field_selector=f"regarding.uid={meta(app)['uid']}"
    )
    _print_head(app)
    _print_conditions(app)
    _print_instances(session, app, instances, all_of_them=robot is None)
    _print_events(listing.items)


def _print_head(app: Json) -> None:
    summary, counts = status(app).get("summary") or {}, status(app).get("instanceCounts") or {}
    parts = [f"{meta(app)['namespace']}/{meta(app)['name']}", status(app).get("phase", "Pending")]
    is_sweep = app["spec"].get("matrix") is not None  # its READY has the same counts in other words
    if summary.get("ready") and not is_sweep:
        parts.append(f"{'done' if has_ended(app) else 'ready'} {summary['ready']}")
    if counts.get("desired", 0) > 1 or is_sweep:
        parts.append(
            _count_instances(counts, noun="run" if is_sweep else "instance", has_ended=is_sweep or has_ended(app))
        )
    parts += [f"{key} {summary[key]}" for key in ("rmw", "discovery") if summary.get(key)]
    print_line("  ".join(parts), style="bold")
    if status(app).get("observedGeneration") != meta(app).get("generation"):
        print_line("The operator has not seen the latest change yet.", style="yellow")


def _count_instances(counts: Json, *, noun: str, has_ended: bool) -> str:
    """Returns `instances 998/1000 ready, 1 offline, 1 failed`; where some have ended `12 instances: 3 ready, 8 completed, 1 failed`."""
    if counts.get("completed") or has_ended:
        words = [f"{counts[key]} {key}" for key in ("ready", "completed", "offline", "failed") if counts.get(key)]
        total = counts.get("desired", 0)
        return f"{total} {noun}{'' if total == 1 else 's'}: {', '.join(words) or 'none has begun'}"
    troubles = [f"{counts[key]} {key}" for key in ("offline", "failed") if counts.get(key)]
    return ", ".join([f"{noun}s {counts.get('ready', 0)}/{counts['desired']} ready", *troubles])


def _print_conditions(app: Json) -> None:
    rows = [
        [
            item["type"],
            item["status"],
            item.get("reason", ""),
            age(item.get("lastTransitionTime")),
            item.get("message", ""),
        ]
        for item in status(app).get("conditions") or []
        if not _boring(item)
    ]
    blank_line()
    print_table(["CONDITION", "STATUS", "REASON", "SINCE", Column("MESSAGE", wraps=True)], rows)


def _boring(condition: Json) -> bool:
    return condition["type"] in _GOOD_WHEN_FALSE and condition["status"] == "False"


def _print_instances(session: Session, app: Json, instances: list[Instance], *, all_of_them: bool) -> None:
    """Those in trouble in full; of an app of many robots the others as a line each."""
    wide = session.options.output is Output.WIDE
    full = in_full(instances, everything=wide or not all_of_them)
    for each in full:
        _print_instance(app, each, wide=wide)
    others = sorted((each for each in instances if each not in full), key=lambda each: each.name)
    if others:
        blank_line()
        print_table(
            [name_instance_kind(app).upper(), "READY", "PHASE", "DOMAIN", "BUDGET", "DEVICES", "NODES"],
            map(_line, others),
        )
        command = session.write_command("info", str(meta(app)["name"]), "--robot", others[0].name)
        print_line(f"One of them in full: {command}; all of them: -o wide")
    missing = (status(app).get("instanceCounts") or {}).get("desired", 0) - len(instances)
    if all_of_them and missing > 0:
        blank_line()
        text = f"{missing} of the app's instances have no RobotAppInstance yet; the operator writes it."
        print_line(text, style="yellow")


def _line(instance: Instance) -> list[str]:
    domain = "" if instance.domain is None else str(instance.domain)
    values = {key: str(instance.summary.get(key, "")) for key in ("ready", "budget", "devices", "nodes")}
    phase = str(instance.observed.get("phase", ""))
    return [instance.name, values["ready"], phase, domain, values["budget"], values["devices"], values["nodes"]]


def _print_instance(app: Json, instance: Instance, *, wide: bool) -> None:
    where = f"{name_instance_kind(app)} {instance.name}" if instance.name else "instance"
    domain = "" if instance.domain is None else f", domain {instance.domain}"
    blank_line()
    phase = instance.observed.get("phase", Phase.PENDING.value)
    ended = instance.observed.get("completionTime")
    since = f" {age(ended)} ago" if ended else ""
    print_line(f"{where}{domain}, {phase}{since}", style="bold")
    wrong = _wrong(app, instance)
    if wrong:
        print_line(f"  {wrong}", style="yellow")
    components = instance.components
    messages = name_repeated([c["name"] for c in components], [c.get("message", "") for c in components])
    rows = [
        [c["name"], c.get("node", ""), _describe_readiness(c), str(c.get("restarts", 0)), message]
        for c, message in zip(components, messages, strict=True)
    ]
    if rows:
        print_table(["COMPONENT", "NODE", "READY", "RESTARTS", Column("MESSAGE", wraps=True)], rows, indent=2)
    _print_helpers(instance)
    _print_links(instance)
    for each in instance.observed.get("moves") or ():
        if times := each.get("times"):
            counted = f", {len(times)} moves recorded" if len(times) > 1 else ""
            print_line(f"  {each['component']} was moved {age(max(times))} ago{counted}")
    if wide and (claims := instance.observed.get("claims")):
        print_line(f"  claims {', '.join(claims)}")
    print_edges(with_percentiles(app, instance.edges), omitted=instance.observed.get("edgesOmitted", 0))


def _describe_readiness(component: Json) -> str:
    """`done` for a job that has completed."""
    if component.get("completed"):
        return "done"
    return "yes" if component.get("ready") else "no"


def _print_helpers(instance: Instance) -> None:
    """Print the pods that the operator added: discovery servers, router or master."""
    rows = [
        [
            helper["name"],
            helper.get("node", ""),
            "yes" if helper.get("ready") else "no",
            str(helper.get("restarts", 0)),
            helper.get("image", ""),
            helper.get("message", ""),
        ]
        for helper in instance.observed.get("helpers") or ()
    ]
    if rows:
        print_table(["HELPER", "NODE", "READY", "RESTARTS", "IMAGE", Column("MESSAGE", wraps=True)], rows, indent=2)


def _print_links(instance: Instance) -> None:
    """Prints the addresses of the components' services."""
    rows = [[link["component"], link["name"], link["url"]] for link in instance.observed.get("links") or ()]
    if rows:
        print_table(["COMPONENT", "LINK", "ADDRESS"], rows, indent=2)


def _wrong(app: Json, instance: Instance) -> str:
    """What the operator says is wrong with the instance, if anything is."""
    for each in status(app).get("troubled") or []:
        if each.get("instance", "") == instance.name:
            return f"{each.get('reason', '')}: {each.get('message', '')}"
    return "" if instance.well else str(instance.summary.get("message", ""))


def with_percentiles(app: Json, edges: list[Json]) -> list[Json]:
    """The edges of a status with the percentile that the budget in the spec is about: a status has p95 alone, and the verdict."""
    of = {_key(edge): (edge.get("latency") or {}).get("percentile") for edge in app["spec"].get("edges") or []}
    return [edge | {"percentile": of.get(_key(edge))} for edge in edges]


def _key(edge: Json) -> tuple[str, str, str, str]:
    return edge.get("kind", "Topic"), edge["topic"], edge["from"], edge["to"]


def print_edges(edges: list[Json], *, omitted: int = 0) -> None:
    """Edges with the part of the budget they use; `omitted` are those the status had no room for."""
    rows = list(edge_rows(edges))
    if rows:
        blank_line()
        print_table(["EDGE", f"FROM {arrow()} TO", "RTT/BUDGET", "USE", "RTT IS"], rows, indent=2)
    if omitted:
        print_line(f"  and {omitted} more edges")


def edge_rows(edges: list[Json]) -> Iterator[list[str]]:
    for edge in edges:
        budget, p95 = milliseconds(edge.get("budget")), milliseconds(edge.get("p95"))
        lost = bool(edge.get("measured")) and p95 is None
        share = float("inf") if lost else p95 / budget if p95 is not None and budget else None
        time = "unreachable" if lost else short_ms(p95)
        times, use = f"{time}/{short_ms(budget)} ms", bar(share)
        if not budget:
            times, use = f"{time}, no budget" if lost else f"{time} ms, no budget", ""
        elif edge.get("percentile") == MEDIAN and edge.get("measured") and not lost:
            times, use = f"{short_ms(budget)} ms for the median, p95 {time} ms", _VERDICT[edge.get("met")]
        same = len(set(edge.get("nodes") or [])) == 1 and len(edge.get("nodes") or []) == 2
        yield [
            _named(edge),
            f"{edge['from']} {arrow()} {edge['to']}",
            times,
            use,
            "same node" if same else _how_known(edge),
        ]


def _how_known(edge: Json) -> str:
    """`measured 4s ago`, `measured, 80 ms 2s ago`, `estimated (hall, cloud)`, `unknown`."""
    if edge.get("measured"):
        age_s, newest = edge.get("ageSeconds"), edge.get("newest")
        what = f"measured, {newest}" if newest else "measured"
        return what if age_s is None else f"{what} {elapsed(age_s)} ago"
    if not edge.get("estimated"):
        return "unknown"
    zones = ", ".join(dict.fromkeys(edge.get("zones") or ()))
    return f"estimated ({zones})" if zones else "estimated"


def _named(edge: Json) -> str:
    """`/cmd_vel`, `/plan (Service)`."""
    kind = edge.get("kind", "Topic")
    return str(edge["topic"]) if kind == "Topic" else f"{edge['topic']} ({kind})"


def _print_events(events: list[Json]) -> None:
    def when(event: Json) -> str:
        series = event.get("series") or {}
        return str(
            series.get("lastObservedTime") or event.get("eventTime") or event.get("deprecatedLastTimestamp") or ""
        )

    recent = sorted(events, key=when)[-_EVENTS_SHOWN:]
    if recent:
        blank_line()
        rows = [
            [age(when(event)), event.get("type", ""), event.get("reason", ""), event.get("note", "")]
            for event in recent
        ]
        print_table(["SINCE", "EVENT", "REASON", Column("MESSAGE", wraps=True)], rows)
