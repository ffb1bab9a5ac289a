"""`domains`: who holds which DDS domain."""

import msgspec

from robotapp_claims.rules.objects import Claim, Pool
from robotapp_claims.rules.pools import fullness
from robotapp_cli.output import Output, blank_line, print_line, print_table, write_structured
from robotapp_cli.reading.fields import Json, age, meta, plain, status
from robotapp_cli.reading.session import Session
from robotapp_client.api.resources import DOMAINPOOLS, ROBOTCLAIMS


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
        print_line(f"Namespace {session.options.namespace} holds no domain.")


def _of_namespace(claim: Json, namespace: str | None) -> bool:
    return namespace is None or claim["spec"]["holder"]["namespace"] == namespace


def _pool_row(pool: Json, claims: list[Json]) -> list[str]:
    name, spec = meta(pool)["name"], pool["spec"]
    own = [claim for claim in claims if claim["spec"]["domain"]["pool"] == name]
    found = fullness(msgspec.convert(pool, Pool), msgspec.convert(own, list[Claim]))
    return [name, spec["scope"], found.used, str(found.resting), spec["ids"]]


def _domain_row(claim: Json, *, wide: bool) -> list[str]:
    domain, row = claim["spec"]["domain"], _holder_of(claim)
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


def _holder_of(claim: Json) -> tuple[str, str, str]:
    """Returns `namespace/name`, instance and component."""
    holder = claim["spec"]["holder"]
    return f"{holder['namespace']}/{holder['name']}", holder.get("instance", ""), holder.get("component", "")
