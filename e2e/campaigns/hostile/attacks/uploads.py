"""Users with small rights begin to ask the scheduler's port and never end."""

from contextlib import ExitStack
from typing import Final

from campaigns.common.process_use import tree_rss_bytes
from campaigns.hostile.attack import (
    MIB,
    READY_S,
    RETURNED_MIB,
    Outcome,
    judge,
    measure_kept,
    read_memory_limit,
    register,
)
from campaigns.hostile.bystanders import Bystanders, measure_calm
from campaigns.hostile.uploads import Uploader
from campaigns.rigs.ports import ask
from campaigns.rigs.simulated_site import SimulatedSite
from robotapp_testbed.control_plane.namespaces import created

ACCOUNTS: Final = 8
UPLOADS: Final = 3
QUESTIONS: Final = 10
"""Of an honest user, meanwhile."""
APPS: Final = 4
"""Of others that must become Ready meanwhile."""
GROWTH_MIB: Final = 48.0
"""The port takes 39 MiB of this by design (8 MiB of bodies, and buffers of 128 connections); the rest is for the apps of others meanwhile."""


@register("unfinished-questions", f"{ACCOUNTS} viewers begin questions at /what-if, {UPLOADS} each time, and end none")
def hold_questions(site: SimulatedSite) -> Outcome:
    page = f"{site.scheduler.health_url}/what-if?namespace="
    calm_s = measure_calm(site, "uploads")
    with ExitStack() as stack:
        homes = [f"{site.namespace}-{number}" for number in range(ACCOUNTS)]  # accounts of one namespace share its turn
        for home in homes:
            stack.enter_context(created(site.cp, home))
        crowd = {home: stack.enter_context(Uploader(site.cp, home, "viewer")) for home in homes}
        honest = stack.enter_context(Uploader(site.cp, site.namespace, "viewer"))
        ask(page + site.namespace, bearer=honest.token, body=b"{}")  # what the first question loads is no growth
        before_bytes = tree_rss_bytes(site.scheduler.pid)
        peak_bytes, refusals, questions = before_bytes, 0, 0
        bystanders = stack.enter_context(Bystanders(site, "beside-uploads"))
        while questions < QUESTIONS or len(bystanders.ready_s) < APPS:
            bystanders.check()
            for home, uploader in crowd.items():
                uploader.begin(page + home, UPLOADS)
            peak_bytes = max(peak_bytes, tree_rss_bytes(site.scheduler.pid))
            if questions < QUESTIONS:  # an honest user does not ask more often either
                questions += 1
                refusals += ask(page + site.namespace, bearer=honest.token, body=b"{}")[0] == 429
    figures = {
        "scheduler MiB before": before_bytes / MIB,
        "scheduler MiB peak": peak_bytes / MIB,
        "scheduler MiB grown": (peak_bytes - before_bytes) / MIB,
        "scheduler MiB kept": measure_kept(site.scheduler, before_bytes),
        "honest questions": float(questions),
        "honest questions refused": float(refusals),
        "others' apps Ready before s": calm_s,
        "others' apps Ready s": bystanders.slowest_s,
    }
    most = {
        "scheduler MiB peak": read_memory_limit("scheduler") / MIB,
        "scheduler MiB grown": GROWTH_MIB,
        "scheduler MiB kept": RETURNED_MIB,
        "honest questions refused": 0,
        "others' apps Ready s": max(READY_S, calm_s),
    }
    return judge(figures, most)
