"""`domains` and `devices`: who holds what."""

import msgspec

from robotapp_api.claims.fullness import fullness
from robotapp_api.claims.identity import device_label
from robotapp_api.claims.objects import Claim, Pool
from robotapp_api.client.resources import DOMAINPOOLS, NODETELEMETRIES, ROBOTCLAIMS
from robotapp_cli.fields import Json, age, meta, plain, status
from robotapp_cli.output import Column, Output, blank_line, console, print_table, write_structured
from robotapp_cli.session import Session


async def show_domains(session: Session) -> None:
    """Pools with how full they are, and every claimed id with its holder."""
    pools = (await session.client.list(DOMAINPOOLS)).items
    claims = [claim for claim in (await session.client.list(ROBOTCLAIMS)).items if "domain" in claim["spec"]]
    claims.sort(key=lambda claim: (claim["spec"]["domain"]["pool"], claim["spec"]["domain"]["id"]))
    shown = [claim for claim in claims if _of_namespace(claim, session.options.namespace)]
    if session.options.output.structured:
        found = {"pools": [plain(pool) for pool in pools], "claims": [plain(claim) for claim in shown]}
        write_structured(found, session.options.output)
        return
    wide = session.options.output is Output.WIDE
    print_table(["POOL", "SCOPE", "CLAIMED", "FREE AGAIN SOON", "IDS"], [_pool_row(pool, claims) for pool in pools])
    if shown:
        blank_line()
        columns = ["DOMAIN", "POOL", "HOLDER", "INSTANCE", "PHASE", "AGE", *(["CLAIM"] if wide else [])]
        print_table(columns, [_domain_row(claim, wide=wide) for claim in shown])
    elif session.options.namespace:
        console().print(f"Namespace {session.options.namespace} holds no domain.", soft_wrap=True)


def _of_namespace(claim: Json, namespace: str | None) -> bool:
    return namespace is None or claim["spec"]["holder"]["namespace"] == namespace


def _pool_row(pool: Json, claims: list[Json]) -> list[str]:
    name, spec = meta(pool)["name"], pool["spec"]
    own = [claim for claim in claims if claim["spec"]["domain"]["pool"] == name]
    found = fullness(msgspec.convert(pool, Pool), msgspec.convert(own, list[Claim]))
    return [name, spec["scope"], found.used, str(found.resting), spec["ids"]]


def _domain_row(claim: Json, *, wide: bool) -> list[str]:
    domain, row = claim["spec"]["domain"], _holder(claim)
    scope = f"/{domain['scopeValue']}" if domain.get("scopeValue") else ""
    found = [
        str(domain["id"]),
        f"{domain['pool']}{scope}",
        row[0],
        row[1],
        status(claim).get("phase", ""),
        age(meta(claim).get("creationTimestamp")),
    ]
    return [*found, meta(claim)["name"]] if wide else found


def _holder(claim: Json) -> tuple[str, str, str]:
    holder = claim["spec"]["holder"]
    return f"{holder['namespace']}/{holder['name']}", holder.get("instance", ""), holder.get("component", "")


async def show_devices(session: Session) -> None:
    """Every device a node reports, with its holder. A claimed one that no NodeTelemetry reports may be there all the same: a label of the node can name it."""
    telemetry = (await session.client.list(NODETELEMETRIES)).items
    claims = {
        (claim["spec"]["device"]["node"], claim["spec"]["device"]["id"]): claim
        for claim in (await session.client.list(ROBOTCLAIMS)).items
        if "device" in claim["spec"]
    }
    rows = [
        _device(meta(node)["name"], device, claims)
        for node in telemetry
        for device in status(node).get("devices") or []
    ]
    seen = {(row["node"], device_label(row["device"])) for row in rows}
    rows += [_unreported(claim) for key, claim in claims.items() if key not in seen]
    if namespace := session.options.namespace:
        rows = [row for row in rows if not row["holder"] or row["holder"].startswith(f"{namespace}/")]
    rows.sort(key=lambda row: (row["node"], row["device"]))
    if session.options.output.structured:
        write_structured({"devices": rows}, session.options.output)
        return
    if not rows:
        console().print(
            "No node reports a device. NodeTelemetry is written by the node agents: kubectl get nodetelemetries",
            soft_wrap=True,
        )
        return
    keys = ["node", "device", "type", "model", "interface", "present", "holder", "instance", "component", "phase"]
    wide = session.options.output is Output.WIDE
    keys = [*keys, "claim", "path"] if wide else [key for key in keys if _tells(key, rows)]
    columns = [Column(key.upper(), wraps=key == "path") for key in keys]
    print_table(columns, [[row[key] or ("free" if key == "holder" else "") for key in keys] for row in rows])


def _tells(key: str, rows: list[dict[str, str]]) -> bool:
    """Is the column worth its width? Models and interfaces where there are any, presence where something is missing."""
    usual = {"model": "", "interface": "", "present": "yes"}
    return key not in usual or any(row[key] != usual[key] for row in rows)


def _device(node: str, device: Json, claims: dict[tuple[str, str], Json]) -> dict[str, str]:
    claim = claims.get((node, device_label(device["id"])))
    found = {"node": node, "device": device["id"], "present": "yes" if device.get("present") else "no"}
    found |= {key: device.get(key, "") for key in ("type", "model", "interface", "path")}
    return found | _claim_fields(claim)


def _unreported(claim: Json) -> dict[str, str]:
    thing = claim["spec"]["device"]
    found = {"node": thing["node"], "device": thing["id"], "type": thing["type"], "present": "unknown"}
    return found | dict.fromkeys(("model", "interface", "path"), "") | _claim_fields(claim)


def _claim_fields(claim: Json | None) -> dict[str, str]:
    if claim is None:
        return dict.fromkeys(("holder", "instance", "component", "phase", "claim"), "")
    holder, instance, component = _holder(claim)
    phase = status(claim).get("phase", "")
    return {
        "holder": holder,
        "instance": instance,
        "component": component,
        "phase": phase,
        "claim": meta(claim)["name"],
    }
