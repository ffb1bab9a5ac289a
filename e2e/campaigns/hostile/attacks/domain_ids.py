"""Tenants reach for the domain ids of others: all ids of a pool, and ids that two pools list."""

import time
from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack
from typing import Any, Final

from campaigns.hostile.attack import READY_S, Outcome, judge, read_quota, register
from campaigns.hostile.bystanders import POOL, Bystanders, measure_calm
from campaigns.hostile.intruder import Intruder, intruding
from campaigns.rigs.appwatch import condition
from campaigns.rigs.live import CLAIMS, POOLS, pool
from campaigns.rigs.simulated_site import Object, SimulatedSite, plain_app
from robotapp_api.model.names import PoolCondition, Reason
from robotapp_testbed import wait_until

TENANTS: Final = 3
APPS: Final = 60
"""Of each tenant: half as many again as the chart's quota."""
OTHERS_AFTER: Final = 4
PATIENCE_S: Final = 180.0
NOTICED_S: Final = 10.0
YOUNGER: Final = "younger"
REFUSALS: Final = (Reason.QUOTA_EXCEEDED, Reason.DOMAIN_EXHAUSTED, Reason.POOL_OVERLAPS)


@register("all-domain-ids", f"a tenant wants {APPS} ids with the chart's quota, then {TENANTS - 1} more tenants do")
def take_all_ids(site: SimulatedSite) -> Outcome:
    quota = read_quota()
    calm_s = measure_calm(site, "ids")
    with ExitStack() as stack:
        first, *later_tenants = [stack.enter_context(intruding(site, f"greedy-{number}")) for number in range(TENANTS)]
        with Bystanders(site, "beside-ids") as bystanders:
            want_ids(first)
            wait_until(lambda: not list_unsettled(first), timeout_s=PATIENCE_S, poll_s=0.5)
            bystanders.wait_for_more(OTHERS_AFTER)
        first_count = count_claims(site, first)
        refusals = [str(read_allocated(app).get("message", "")) for app in list_refused(first)]
        unsettled = len(list_unsettled(first))
        for tenant in later_tenants:
            want_ids(tenant)
        full_s = measure_condition(site, POOL, PoolCondition.FULL)
        most_held = max(count_claims(site, tenant) for tenant in (first, *later_tenants))
        doubles = count_doubles(site, [POOL])
    figures = {
        "ids of the first tenant": float(first_count),
        "most ids of a tenant": float(most_held),
        "apps neither Allocated nor refused": float(unsettled),
        "refusals without a cure": float(sum("ask for a higher quota" not in text for text in refusals)),
        "refusals": float(len(refusals)),
        "pool Full shown after s": full_s,
        "ids given twice": float(doubles),
        "others' apps Ready before s": calm_s,
        "others' apps Ready s": bystanders.slowest_s,
    }
    most = {
        "ids of the first tenant": quota,
        "most ids of a tenant": quota,
        "apps neither Allocated nor refused": 0,
        "refusals without a cure": 0,
        "pool Full shown after s": PATIENCE_S,
        "ids given twice": 0,
        "others' apps Ready s": max(READY_S, calm_s),
    }
    return judge(figures, most)


@register("overlapping-pools", "a younger pool of the network lists the same ids, and a tenant asks it for them")
def overlap_pools(site: SimulatedSite) -> Outcome:
    calm_s = measure_calm(site, "overlap")
    with ExitStack() as stack:
        intruder = stack.enter_context(intruding(site, "neighbour"))
        bystanders = stack.enter_context(Bystanders(site, "beside-overlap"))
        bystanders.wait_for_more(1)
        stack.enter_context(pool(site.cp, YOUNGER, ids="1-101", network=""))
        overlapping_s = measure_condition(site, YOUNGER, PoolCondition.OVERLAPPING)
        for number in (None, 1, 50):
            wish: Object = {} if number is None else {"domain": number}
            intruder.create(plain_app(f"asks-{number or 'any'}", parts=("only",), ros2={"pool": YOUNGER, **wish}))
        wait_until(lambda: len(list_refused(intruder)) == 3, timeout_s=NOTICED_S)
        refused_apps = list_refused(intruder)
        bystanders.wait_for_more(OTHERS_AFTER)
        naming_count = sum(f"DomainPool {POOL}" in read_allocated(app)["message"] for app in refused_apps)
        doubles = count_doubles(site, [POOL, YOUNGER])
    figures = {
        "Overlapping shown after s": overlapping_s,
        "apps of the younger pool not refused": 3.0 - len(refused_apps),
        "refusals that do not name the other pool": float(len(refused_apps) - naming_count),
        "ids given twice": float(doubles),
        "others' apps Ready before s": calm_s,
        "others' apps Ready s": bystanders.slowest_s,
    }
    most = {
        "Overlapping shown after s": NOTICED_S,
        "apps of the younger pool not refused": 0,
        "refusals that do not name the other pool": 0,
        "ids given twice": 0,
        "others' apps Ready s": max(READY_S, calm_s),
    }
    return judge(figures, most)


def want_ids(tenant: Intruder) -> None:
    for number in range(APPS):
        tenant.create(plain_app(f"greedy-{number}", parts=("only",), ros2={"pool": POOL, "rmw": "rmw_cyclonedds_cpp"}))


def read_allocated(app: Object) -> Any:
    return condition(app, "Allocated")


def list_refused(tenant: Intruder) -> list[Object]:
    return [app for app in tenant.list_apps() if is_refused(app)]


def is_refused(app: Object) -> bool:
    """Tells whether an app has no id, and its status says why."""
    allocated = read_allocated(app)
    return allocated.get("status") == "False" and allocated["reason"] in REFUSALS


def list_unsettled(tenant: Intruder) -> list[Object]:
    """Returns the apps that neither have an id nor a refusal."""
    return [app for app in tenant.list_apps() if read_allocated(app).get("status") != "True" and not is_refused(app)]


def count_claims(site: SimulatedSite, tenant: Intruder) -> int:
    claims = site.cp.api.get(CLAIMS)["items"]
    return sum(claim["spec"]["holder"]["namespace"] == tenant.namespace for claim in claims)


def count_doubles(site: SimulatedSite, pools: Sequence[str]) -> int:
    """Returns how many ids of these pools, which are of one network, have two claims."""
    domains = [claim["spec"].get("domain") or {} for claim in site.cp.api.get(CLAIMS)["items"]]
    counts = Counter(domain["id"] for domain in domains if domain.get("pool") in pools)
    return sum(count > 1 for count in counts.values())


def measure_condition(site: SimulatedSite, name: str, kind: PoolCondition) -> float:
    """Returns the seconds from now until a condition of a pool is True; infinite when it does not become so."""
    began_s = time.monotonic()

    def is_true() -> bool:
        return condition(site.cp.api.get(f"{POOLS}/{name}"), kind).get("status") == "True"

    noticed = wait_until(is_true, timeout_s=PATIENCE_S)
    return time.monotonic() - began_s if noticed else float("inf")
