"""The console before a thousand robots: first screen, updates, memory, rest, what open pages cost the API server, and a busy neighbour."""

import argparse
import asyncio
import json
import os
import re
import statistics
import sys
import time
from collections.abc import AsyncIterator, Iterator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager, contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Final

from campaigns.common import options, process_use
from campaigns.common.output import save, say
from campaigns.console.made_fleet import MadeFleet, make_fleet
from campaigns.console.visitors import OpenPage, Visitor
from robotapp_testbed import ControlPlane, Identity, Process
from robotapp_testbed.control_plane.servers import Program, answers
from robotapp_testbed.machines.topology import SimulatedTelemetry
from robotapp_testbed.processes import ports

Figures = dict[str, Any]
MOST_FIRST_S: Final = 1.0
MOST_UPDATE_S: Final = 0.3
MOST_RSS_BYTES: Final = 200_000_000
MOST_REST_SHARE: Final = 0.05
MOST_PAGE_S: Final = 1.0
MORE_PAGES, FEWER_PAGES = 10, 2
NOISE_PER_S: Final = 200
_PATHS: Final = ("/", "/nodes")
_AGENT: Final = "robotapp-console"
_NODE_LEASE_S: Final = 600
_USERS: Final = {
    "one": Identity(user="one", groups=("system:masters",)),
    "two": Identity(user="two", groups=("system:masters",)),
}


@dataclass(frozen=True, slots=True)
class Rig:
    """The control plane with a fleet; each measurement starts a console of its own."""

    cp: ControlPlane
    fleet: MadeFleet
    seconds: float

    @contextmanager
    def run_console(self) -> Iterator[tuple[Process, str]]:
        """Runs the console as the chart does, for everybody with a token; gives its process and address."""
        (port,) = ports.free_ports(1)
        flags = ("--plain-http", "--listen=127.0.0.1", f"--port={port}")
        api = (f"--api-server={self.cp.server_url}", f"--certificate-authority={self.cp.ca_file}")
        origin = f"http://127.0.0.1:{port}"
        process = Process(
            "console",
            [sys.executable, "-m", "robotapp_console", *flags, *api],
            run_dir=self.cp.run_dir,
            log_path=self.cp.logs_dir / "console.log",
            env=dict(os.environ),
            ready=lambda: answers(f"{origin}/healthz"),
        )
        process.start().wait_ready()
        try:
            yield process, origin
        finally:
            process.stop()

    @asynccontextmanager
    async def visit(self, origin: str, user: str) -> AsyncIterator[Visitor]:
        """Gives a visitor who has signed in."""
        async with Visitor(origin) as visitor:
            await visitor.sign_in(_USERS[user].token)
            yield visitor


def main(argv: Sequence[str] | None = None) -> int:
    arguments = _make_parser().parse_args(argv)
    fleet = make_fleet(arguments.robots)
    with ControlPlane(audit=True, node_lease_s=_NODE_LEASE_S, identities=_USERS) as cp:
        say(f"writing {arguments.robots} robots with three components each")
        fleet.write(cp)
        with SimulatedTelemetry(cp, fleet.topology):
            figures = asyncio.run(_measure(Rig(cp, fleet, arguments.seconds)))
    problems = list_problems(figures)
    print(json.dumps(figures, indent=1))
    for problem in problems:
        print(f"MISSED: {problem}", file=sys.stderr)
    save(arguments.json, {**figures, "problems": problems})
    return 1 if problems else 0


def _make_parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="scripts/bench console", description=__doc__)
    parser.add_argument("--robots", type=options.count(1, 5000), default=1000)
    parser.add_argument(
        "--seconds", type=options.amount, default=30.0, help="how long rest and open pages are measured"
    )
    parser.add_argument("--json", type=options.report, help="also write the figures to this file")
    return parser


async def _measure(rig: Rig) -> Figures:
    figures: Figures = {"robots": len(rig.fleet.robots)}
    with rig.run_console() as (process, origin):
        async with rig.visit(origin, "one") as visitor:
            figures |= await _measure_screens(visitor, process)
            figures |= await _measure_updates(rig, visitor)
            figures |= await _measure_rest(rig, visitor, process)
        async with rig.visit(origin, "one") as noisy, rig.visit(origin, "two") as calm:
            figures |= await _measure_neighbour(noisy, calm)
        figures["peak_rss_mb"] = round(process_use.peak_rss_bytes(process.pid) / 1e6)
    for pages in (FEWER_PAGES, MORE_PAGES):
        figures[f"api_load_of_{pages}_pages"] = await _measure_load(rig, pages)
    return figures


async def _measure_screens(visitor: Visitor, process: Process) -> Figures:
    """The very first screen after the sign-in, for which everything is read, and later ones."""
    say("first screen")
    before_s = process.cpu_seconds()
    _, first_s, _ = await visitor.load("/")
    cpu_s = process.cpu_seconds() - before_s
    later = [await visitor.load(path) for path in _PATHS * 5]
    return {
        "first_screen_s": round(first_s, 3),
        "first_screen_cpu_s": round(cpu_s, 3),
        "later_screens_worst_s": round(max(item[1] for item in later), 3),
    }


async def _measure_updates(rig: Rig, visitor: Visitor) -> Figures:
    """Measures the time from when a write is sent to the API server until the page has what came of it."""
    say("updates")
    robot = rig.fleet.robots[3]
    times = []
    async with visitor.follow("/stream") as page:
        for number in range(20):
            phase = ("Degraded", "Running")[number % 2]
            pattern = re.compile(rf'id="robot-{robot}"(?:(?!</tr>).)*?title="{phase}', re.DOTALL)
            await asyncio.sleep(1.0 + number * 0.07)  # at all moments of the telemetry's period
            write = asyncio.create_task(asyncio.to_thread(rig.fleet.set_phase, rig.cp, robot, phase))
            times.append(await _wait_for_row(page, pattern, robot))
            await write
    return {
        "update_median_s": round(statistics.median(times), 3),
        "update_worst_s": round(max(times), 3),
    }


async def _wait_for_row(page: OpenPage, pattern: re.Pattern[str], robot: str) -> float:
    try:
        return await page.wait_for(pattern, within_s=20)
    except TimeoutError:
        raise TimeoutError(f"the page did not show the change of {robot} within 20 s") from None


async def _measure_rest(rig: Rig, visitor: Visitor, process: Process) -> Figures:
    """One open page; nothing happens but the agents' heartbeats."""
    say("rest")
    async with visitor.follow("/stream") as page:
        await asyncio.sleep(5)
        before_s, fragments = process.cpu_seconds(), page.fragments
        await asyncio.sleep(rig.seconds)
        share = (process.cpu_seconds() - before_s) / rig.seconds
        return {
            "rest_core_share": round(share, 4),
            "rest_fragments_per_s": round((page.fragments - fragments) / rig.seconds, 2),
            "rss_mb": round(process.rss_bytes() / 1e6),
        }


async def _measure_neighbour(noisy: Visitor, calm: Visitor) -> Figures:
    """Pages of a user while another one sends many requests."""
    say("a busy neighbour")
    await calm.load("/")
    ending = asyncio.Event()
    noise_task = asyncio.create_task(_make_noise(noisy, ending))
    pages = []
    for _ in range(20):
        pages.append(await calm.load("/"))
        await asyncio.sleep(0.5)
    ending.set()
    statuses = await noise_task
    return {
        "neighbour_worst_page_s": round(max(item[1] for item in pages), 3),
        "neighbour_pages_refused": sum(status != 200 for status, _, _ in pages),
        "noise_requests": len(statuses),
        "noise_refused": sum(status == 429 for status in statuses),
    }


async def _make_noise(visitor: Visitor, ending: asyncio.Event) -> list[int]:
    """Sends requests at a steady rate, whether they are answered or not, and returns their statuses."""
    tasks = []
    began_s = time.monotonic()
    while not ending.is_set():
        due = int((time.monotonic() - began_s) * NOISE_PER_S)
        tasks += [asyncio.create_task(visitor.load("/")) for _ in range(due - len(tasks))]
        await asyncio.sleep(0.01)
    return [status for status, _, _ in await asyncio.gather(*tasks)]


async def _measure_load(rig: Rig, pages: int) -> Figures:
    """Measures the requests that the API server has from a console with so many open pages of one user, from the sign-in on."""
    say(f"{pages} open pages")
    server = rig.cp.process(Program.API)
    began = datetime.now(UTC)
    with rig.run_console() as (process, origin):
        async with rig.visit(origin, "one") as visitor, AsyncExitStack() as stack:
            for number in range(pages):
                path = _PATHS[number % len(_PATHS)]
                await visitor.load(path)
                await stack.enter_async_context(visitor.follow(f"{path.rstrip('/')}/stream"))
            before_s = server.cpu_seconds()
            await asyncio.sleep(rig.seconds)
            cpu_s = server.cpu_seconds() - before_s
            rss_mb = round(process.rss_bytes() / 1e6)
    records = [item for item in rig.cp.audit(since=began) if _AGENT in item.get("userAgent", "")]
    requests = {
        item["auditID"] for item in records if datetime.fromisoformat(item["requestReceivedTimestamp"]) >= began
    }
    return {"requests": len(requests), "api_server_cpu_share": round(cpu_s / rig.seconds, 3), "console_rss_mb": rss_mb}


def list_problems(figures: Figures) -> list[str]:
    """Returns what is not as it should be."""
    fewer, more = (figures[f"api_load_of_{pages}_pages"]["requests"] for pages in (FEWER_PAGES, MORE_PAGES))
    checks = (
        (figures["first_screen_s"] <= MOST_FIRST_S, f"first screen after {figures['first_screen_s']} s"),
        (figures["update_median_s"] <= MOST_UPDATE_S, f"updates after {figures['update_median_s']} s"),
        (figures["rss_mb"] * 1e6 <= MOST_RSS_BYTES, f"{figures['rss_mb']} MB"),
        (figures["rest_core_share"] <= MOST_REST_SHARE, f"{figures['rest_core_share']:.1%} of a core at rest"),
        (
            figures["neighbour_worst_page_s"] <= MOST_PAGE_S and not figures["neighbour_pages_refused"],
            f"beside a busy user a page took {figures['neighbour_worst_page_s']} s",
        ),
        (more <= fewer, f"{MORE_PAGES} open pages cost {more} requests, {FEWER_PAGES} cost {fewer}"),
    )
    return [words for holds, words in checks if not holds]


if __name__ == "__main__":
    sys.exit(main())
