"""`list` and `info`: RobotApps as the operator sees them."""

from collections.abc import Iterator

from robotapp_api.client.resources import EVENTS, ROBOTAPPS
from robotapp_api.model.names import Condition
from robotapp_cli.fields import Json, age, meta, milliseconds, plain, short_ms, status
from robotapp_cli.output import Column, Output, arrow, bar, blank_line, console, print_table, write_structured
from robotapp_cli.session import Session

_EVENTS_SHOWN = 8
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
        console().print(
            f"No RobotApp in {where}. The smallest one: kubectl apply -f examples/minimal.yaml", soft_wrap=True
        )
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


async def show_info(session: Session, name: str) -> None:
    """One RobotApp: conditions, instances, edges, what happened."""
    app = await session.client.get(ROBOTAPPS, name, namespace=session.home)
    if session.options.output.structured:
        write_structured(plain(app), session.options.output)
        return
    listing = await session.client.list(
        EVENTS, namespace=session.home, field_selector=f"regarding.uid={meta(app)['uid']}"
    )
    _print_head(app)
    _print_conditions(app)
    for instance in status(app).get("instances") or []:
        _print_instance(instance)
    _print_events(listing.items)


def _print_head(app: Json) -> None:
    summary = status(app).get("summary") or {}
    parts = [f"{meta(app)['namespace']}/{meta(app)['name']}", status(app).get("phase", "Pending")]
    parts += [f"ready {summary['ready']}"] if summary.get("ready") else []
    parts += [f"{key} {summary[key]}" for key in ("rmw", "discovery") if summary.get(key)]
    console().print("  ".join(parts), style="bold", soft_wrap=True)
    if status(app).get("observedGeneration") != meta(app).get("generation"):
        console().print("The operator has not seen the latest change yet.", style="yellow", soft_wrap=True)


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


def _print_instance(instance: Json) -> None:
    where = f"robot {instance['robot']}" if instance.get("robot") else "instance"
    domain = f", domain {instance['domain']}" if "domain" in instance else ""
    blank_line()
    console().print(f"{where}{domain}, {instance.get('phase', '')}", style="bold", soft_wrap=True)
    rows = [
        [
            c["name"],
            c.get("node", ""),
            "yes" if c.get("ready") else "no",
            str(c.get("restarts", 0)),
            c.get("message", ""),
        ]
        for c in instance.get("components") or []
    ]
    print_table(["COMPONENT", "NODE", "READY", "RESTARTS", Column("MESSAGE", wraps=True)], rows, indent=2)
    print_edges(instance.get("edges") or [])


def print_edges(edges: list[Json]) -> None:
    """Edges with the part of the budget they use."""
    rows = list(edge_rows(edges))
    if rows:
        blank_line()
        print_table(["EDGE", f"FROM {arrow()} TO", "RTT/BUDGET", "USE", "RTT IS"], rows, indent=2)


def edge_rows(edges: list[Json]) -> Iterator[list[str]]:
    for edge in edges:
        budget, p95 = milliseconds(edge.get("budget")), milliseconds(edge.get("p95"))
        share = p95 / budget if p95 is not None and budget else None
        known = "measured" if edge.get("measured") else "estimated" if p95 is not None else "unknown"
        same = len(set(edge.get("nodes") or [])) == 1 and len(edge.get("nodes") or []) == 2
        yield [
            edge["topic"],
            f"{edge['from']} {arrow()} {edge['to']}",
            f"{short_ms(p95)}/{short_ms(budget)} ms" if budget else f"{short_ms(p95)} ms, no budget",
            bar(share) if budget else "",
            "same node" if same else known,
        ]


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
