"""Users with small rights begin to ask the scheduler's port and never end."""

import time
from contextlib import ExitStack
from typing import Final

from campaigns.common.process_use import tree_rss_bytes
from campaigns.hostile.attack import MIB, Outcome, judge, read_memory_limit, register
from campaigns.hostile.bystanders import Bystanders
from campaigns.hostile.uploads import Uploader
from campaigns.rigs.ports import ask
from campaigns.rigs.simulated_site import SimulatedSite

ACCOUNTS: Final = 8
UPLOADS: Final = 30
HELD_S: Final = 15.0
GROWTH_MIB: Final = 48.0
READY_S: Final = 3.0


@register("unfinished-questions", f"{ACCOUNTS} viewers begin {UPLOADS} questions each at /what-if and end none")
def hold_questions(site: SimulatedSite) -> Outcome:
    page = f"{site.scheduler.health_url}/what-if?namespace={site.namespace}"
    with ExitStack() as stack:
        uploaders = [
            stack.enter_context(Uploader(site.cp, site.namespace, f"viewer-{number}")) for number in range(ACCOUNTS + 1)
        ]
        *crowd, honest = uploaders
        before_bytes = tree_rss_bytes(site.scheduler.pid)
        peak_bytes, refusals, questions = before_bytes, 0, 0
        bystanders = stack.enter_context(Bystanders(site, "beside-uploads"))
        until_s = time.monotonic() + HELD_S
        while time.monotonic() < until_s:
            for uploader in crowd:
                uploader.begin(page, UPLOADS // 10)
            peak_bytes = max(peak_bytes, tree_rss_bytes(site.scheduler.pid))
            if questions < 10:  # an honest user does not ask more often either
                questions += 1
                refusals += ask(page, bearer=honest.token, body=b"{}")[0] == 429
    figures = {
        "scheduler MiB before": before_bytes / MIB,
        "scheduler MiB peak": peak_bytes / MIB,
        "scheduler MiB grown": (peak_bytes - before_bytes) / MIB,
        "honest questions": float(questions),
        "honest questions refused": float(refusals),
        "others' apps Ready s": bystanders.slowest_s,
    }
    most = {
        "scheduler MiB peak": read_memory_limit("scheduler") / MIB,
        "scheduler MiB grown": GROWTH_MIB,
        "honest questions refused": 0,
        "others' apps Ready s": READY_S,
    }
    return judge(figures, most)
