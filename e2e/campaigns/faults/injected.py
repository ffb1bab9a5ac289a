"""The faults by name. Each waits until part of the pods are bound, strikes, and says when it is over."""

import asyncio
import time
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from tests.support.proxy import answer, delay, drop, lose_reply, reset

from campaigns.faults.crew import LOST_LEADERSHIP
from campaigns.faults.run import Run
from campaigns.speed.contestants import OURS
from robotapp_client.api.resources import LEASES

STOPPED_S: Final = 60.0
LEAST_CUTS: Final = 5
LIBFAKETIME: Final = tuple(
    Path(f"/usr/lib/{arch}-linux-gnu/faketime/libfaketimeMT.so.1") for arch in ("x86_64", "aarch64")
)
CLOCK_FILE: Final = "FAKETIME_TIMESTAMP_FILE"


@dataclass(frozen=True, slots=True)
class Fault:
    """How a run is set up for it, and what it does."""

    strike: Callable[[Run], Awaitable[None]]
    text: str
    schedulers: int = 1
    through_proxy: bool = False
    clock: bool = False
    """Needs libfaketime."""
    wall_only: bool = False


async def none(run: Run) -> None:
    await run.bound(0.9)


async def api_restart(run: Run) -> None:
    await _down(run, "kube-apiserver", at=0.2, for_s=2.0)
    await _down(run, "kube-apiserver", at=0.6, for_s=2.0)


async def api_outage(run: Run) -> None:
    """Longer than a lease lasts: the leader ends, its next life goes on."""
    await _down(run, "kube-apiserver", at=0.4, for_s=20.0)


async def etcd_restart(run: Run) -> None:
    await _down(run, "etcd", at=0.2, for_s=2.0)
    await _down(run, "etcd", at=0.6, for_s=2.0)


async def watches(run: Run) -> None:
    cuts = 0
    bound = asyncio.create_task(run.bound(0.97))
    while not bound.done() or cuts < LEAST_CUTS:
        await asyncio.sleep(1.0)
        await asyncio.to_thread(run.proxy.cut_watches)
        cuts += 1
    await bound
    run.ended()
    run.notes["times cut"] = cuts


async def storm(run: Run) -> None:
    """A third of all writes goes wrong in one of eight ways; reads now and then too."""
    ways = [
        (answer(409, "Conflict"), 0.04),
        (answer(429, "TooManyRequests", retry_after_s=1), 0.04),
        (answer(500, "InternalError"), 0.04),
        (answer(500, "InternalError", applied=True), 0.04),
        (answer(504, "Timeout", applied=True), 0.08),
        (answer(503, "ServiceUnavailable"), 0.04),
        (lose_reply(), 0.04),
        (reset(), 0.03),
    ]
    rules = [run.proxy.add(fault, verbs="write", times=None, probability=chance) for fault, chance in ways]
    rules += [
        run.proxy.add(drop(), verbs=["get", "list"], times=None, probability=0.03),
        run.proxy.add(answer(500, "InternalError"), verbs=["get", "list"], times=None, probability=0.03),
        run.proxy.add(delay(0.5), verbs="write", times=None, probability=0.02),
    ]
    await run.bound(0.9, within_s=600.0)
    run.proxy.clear()
    run.ended()
    run.notes["answers falsified"] = sum(rule.struck for rule in rules)


async def two_schedulers(run: Run) -> None:
    """The leader dies; its successor has the lease taken away and must end."""
    await run.bound(0.25)
    first = await run.leader()
    first.stays_down = True
    run.crew.kill(first)
    killed_s = time.monotonic()
    second = await run.leader(other_than=first.process.name)
    run.notes["takeover s"] = round(time.monotonic() - killed_s, 1)
    first.stays_down = False
    await run.bound(0.6)
    second = await run.leader()  # another one by now, if the machine kept it from renewing in time
    exits = second.exits[LOST_LEADERSHIP]
    stolen = {"spec": {"holderIdentity": "somebody-else", "leaseDurationSeconds": 1}}
    await run.client.patch(LEASES, OURS.lease, stolen, namespace=OURS.lease_namespace)
    await _until(lambda: second.exits[LOST_LEADERSHIP] > exits, within_s=30, what="a leader without a lease goes on")
    run.ended()


async def zombie(run: Run) -> None:
    """The leader stands still for a minute, wakes up, and must end without having bound anything."""
    await run.bound(0.25)
    old = await run.leader()
    old.process.pause()
    stopped_s = time.monotonic()
    await run.leader(other_than=old.process.name)
    run.notes["takeover s"] = round(time.monotonic() - stopped_s, 1)
    await asyncio.sleep(max(0.0, STOPPED_S - (time.monotonic() - stopped_s)))
    exits = old.exits[LOST_LEADERSHIP]
    name, woken_s = old.process.name, time.monotonic()
    old.process.resume()
    await _until(lambda: old.exits[LOST_LEADERSHIP] > exits, within_s=30, what="the old leader does not end")
    run.notes["zombie ended s"] = round(time.monotonic() - woken_s, 2)
    late = [
        write
        for write in run.proxy.ledger.writes(component=name, resource="pods/binding")
        if write.at_s >= woken_s + 0.05 and write.at_s < time.monotonic()
    ]
    run.notes["bindings by the zombie"] = len(late)
    if late:
        run.problems.append(f"the old leader sent {len(late)} bindings after it woke up")
    run.ended()


async def clock_wall(run: Run) -> None:
    """The wall clock of the scheduler jumps forth and back."""
    for part, jump in ((0.2, "+1h"), (0.4, "-1d"), (0.6, "+365d"), (0.75, "+0")):
        await run.bound(part)
        _set_clock(run, jump)
        run.ended()


async def clock_all(run: Run) -> None:
    """All clocks of the scheduler jump forth, as in a machine that was suspended: its lease is over at once."""
    await run.bound(0.3)
    _set_clock(run, "+10m")
    run.ended()
    await run.bound(0.6)
    _set_clock(run, "+7d")
    run.ended()


FAULTS: Final[Mapping[str, Fault]] = {
    "none": Fault(none, "nothing, to compare with"),
    "api-restart": Fault(api_restart, "API server killed twice, back after 2 s"),
    "api-outage": Fault(api_outage, "API server killed, back after 20 s"),
    "etcd-restart": Fault(etcd_restart, "etcd killed twice, back after 2 s"),
    "watches": Fault(watches, "every watch closed every second", through_proxy=True),
    "storm": Fault(
        storm,
        "a third of the writes answered 409, 429, 500, 503, 504 or not at all, half of these applied",
        through_proxy=True,
    ),
    "two-schedulers": Fault(two_schedulers, "leader killed, its successor's lease stolen", schedulers=2),
    "zombie": Fault(zombie, "leader stopped for 60 s, then woken", schedulers=2, through_proxy=True),
    "clock-wall": Fault(clock_wall, "wall clock +1 h, -1 d, +1 y, back", clock=True, wall_only=True),
    "clock-all": Fault(clock_all, "all clocks +10 min, +7 d", clock=True),
}


def clock_environment(fault: Fault, folder: Path) -> dict[str, str]:
    """What makes a process take its time from a file. Raises FileNotFoundError without libfaketime."""
    library = next((path for path in LIBFAKETIME if path.exists()), None)
    if library is None:
        raise FileNotFoundError("clock faults need libfaketime (Debian, Ubuntu: apt-get install libfaketime)")
    clock = folder / "clock"
    clock.write_text("+0")
    found = {"LD_PRELOAD": str(library), CLOCK_FILE: str(clock), "FAKETIME_NO_CACHE": "1"}
    return found | ({"FAKETIME_DONT_FAKE_MONOTONIC": "1"} if fault.wall_only else {})


def _set_clock(run: Run, jump: str) -> None:
    Path(run.plan.environment[CLOCK_FILE]).write_text(jump)


async def _down(run: Run, program: str, *, at: float, for_s: float) -> None:
    await run.bound(at)
    process = run.cp.process(program)
    await asyncio.to_thread(process.kill)
    await asyncio.sleep(for_s)
    await asyncio.to_thread(lambda: process.start().wait_ready())
    if program == "etcd":
        await asyncio.to_thread(run.cp.process("kube-apiserver").wait_ready)
    run.ended()


async def _until(condition: Callable[[], bool], *, within_s: float, what: str) -> None:
    deadline_s = time.monotonic() + within_s
    while not condition():
        if time.monotonic() > deadline_s:
            raise TimeoutError(what)
        await asyncio.sleep(0.02)
