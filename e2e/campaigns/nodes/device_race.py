"""Two schedulers race for devices of real nodes: ours and kube-scheduler allocate the same serial ports to claims of their pods.

Each of two real nodes has half of the devices (pseudo-terminals that send everything back) and the driver, which `--kills`
ends with SIGKILL at random moments. Every second pod is of kube-scheduler. A pod opens its device, writes lines and reads them
again: a program beside it on the same device would read some of them. It leaves when it had the device, and ends. Judged are the
lines, the times, and that all pods ran. Needs root.
"""

import argparse
import random
import statistics
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

from campaigns.common import options
from campaigns.common.output import save, say
from campaigns.nodes.claims import claim, driver_on, selector_for, talk_alone, user_of, wait_published
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.control_plane.product import install, start_scheduler
from robotapp_testbed.machines.nodes import Device, robot
from robotapp_testbed.processes.process import Process
from robotapp_testbed.real import RealNodes, UnavailableError, prerequisites

Json = dict[str, Any]
NODES: Final = ("robot-1", "robot-2")
SCHEDULERS: Final = ("ros-aware-scheduler", "default-scheduler")
NAMESPACE: Final = "device-race"
LINES: Final = 10
"""Written and read again by each program, 0.1 s apart."""
REFUSED: Final = "is in use by claim"
POLL_S: Final = 1.0
KILL_S: Final = 2.0
"""At most so long between two kills."""


SERIAL: Final = selector_for("serial")


@dataclass(frozen=True, slots=True)
class Use:
    """One program had one device: seconds of the machine's clock."""

    pod: str
    device: str
    begun_s: float
    ended_s: float


@dataclass(frozen=True, slots=True)
class Result:
    """The whole race, as `--json` has it."""

    pods: int
    devices: int
    ran: Mapping[str, int]
    """Pods that had a device to themselves, by scheduler."""
    refused: Mapping[str, int]
    """Pods whose device the driver refused at first, since another claim had it, by scheduler."""
    devices_used: int
    kills: int
    seconds: float
    median_use_s: float
    problems: list[str]


def devices_of(node: str, count: int) -> list[Device]:
    """Serial ports that differ in their serial numbers."""
    offset = NODES.index(node) * count
    serials = [f"A50285{offset + number:02d}" for number in range(count)]
    return [
        Device(f"serial-0403-6001-{serial.lower()}", "serial", identity=f"0403:6001:{serial}") for serial in serials
    ]


def read_use(pod: Mapping[str, Any]) -> Use | None:
    """Reads what the pod's program wrote when it ended; None for one that has not ended, or not well."""
    statuses = pod["status"].get("containerStatuses") or [{}]
    words = statuses[0].get("state", {}).get("terminated", {}).get("message", "").split()
    if pod["status"].get("phase") != "Succeeded" or len(words) != 3:
        return None
    device, begun, ended = words
    return Use(pod["metadata"]["name"], f"{pod['spec']['nodeName']} {device}", float(begun), float(ended))


def find_overlaps(uses: Iterable[Use]) -> list[str]:
    """A line for every two programs that had one device at the same moment."""
    by_device: dict[str, list[Use]] = defaultdict(list)
    for use in uses:
        by_device[use.device].append(use)
    lines = []
    for device, in_turn in by_device.items():
        latest: Use | None = None
        for use in sorted(in_turn, key=lambda one: one.begun_s):
            if latest and use.begun_s < latest.ended_s:
                lines.append(f"{device}: {use.pod} had it from {use.begun_s} on, {latest.pod} until {latest.ended_s}")
            latest = use if latest is None or use.ended_s > latest.ended_s else latest
    return lines


def judge(pods: Sequence[Json], events: Sequence[Json], *, devices: int, kills: int, seconds: float) -> Result:
    """Compares what all pods left; `events` are those of their namespace."""
    scheduler_of = {pod["metadata"]["name"]: pod["spec"]["schedulerName"] for pod in pods}
    uses = {pod["metadata"]["name"]: use for pod in pods if (use := read_use(pod))}
    refused = {event["involvedObject"]["name"] for event in events if REFUSED in (event.get("message") or "")}
    problems = find_overlaps(uses.values())
    problems += [_describe_failure(pod) for pod in pods if pod["metadata"]["name"] not in uses]
    return Result(
        pods=len(pods),
        devices=devices,
        ran=dict(Counter(scheduler_of[name] for name in uses)),
        refused=dict(Counter(scheduler_of[name] for name in refused if name in scheduler_of)),
        devices_used=len({use.device for use in uses.values()}),
        kills=kills,
        seconds=round(seconds, 1),
        median_use_s=round(statistics.median([use.ended_s - use.begun_s for use in uses.values()] or [0.0]), 2),
        problems=problems,
    )


def _describe_failure(pod: Json) -> str:
    statuses = pod["status"].get("containerStatuses") or [{}]
    conditions = [
        condition.get("message", "")
        for condition in pod["status"].get("conditions") or ()
        if condition["status"] == "False"
    ]
    return (
        f"{pod['metadata']['name']} of {pod['spec']['schedulerName']} on {pod['spec'].get('nodeName', 'no node')}: "
        f"{pod['status'].get('phase')} {statuses[0].get('state', '')} {' '.join(conditions)}"
    )


def user(number: int) -> Json:
    """Every second pod is of kube-scheduler."""
    line = (
        f"begun=$(cut -d' ' -f1 /proc/uptime); {talk_alone(LINES)}; "
        'echo "$ROBOTAPP_DEVICE_ARM $begun $(cut -d" " -f1 /proc/uptime)" > /dev/termination-log'
    )
    name = f"user-{number}"
    scheduler = SCHEDULERS[number % len(SCHEDULERS)]
    return user_of(name, name, ["sh", "-c", line], schedulerName=scheduler, restartPolicy="Never")


def race(cp: RealNodes, drivers: Sequence[Process], *, pods: int, kills: int, within_s: float) -> tuple[int, float]:
    """Creates all claims and pods and waits for their ends. Returns how often a driver was killed, and seconds."""
    cp.kubectl("apply", "-n", NAMESPACE, "-f", "-", stdin=[claim(f"user-{n}", {"arm": SERIAL}) for n in range(pods)])
    begun_s = time.monotonic()
    cp.kubectl("apply", "-n", NAMESPACE, "-f", "-", stdin=[user(number) for number in range(pods)])
    kill_count = polls = 0
    while time.monotonic() < begun_s + within_s:
        phases = Counter(pod["status"].get("phase") for pod in _items(cp, "pods"))
        if phases["Succeeded"] + phases["Failed"] == pods:
            break
        if polls % 10 == 0:
            say(", ".join(f"{count} {phase}" for phase, count in sorted(phases.items())) + f", {kill_count} kills")
        polls += 1
        time.sleep(random.uniform(0.1, KILL_S) if kill_count < kills else POLL_S)
        if kill_count < kills:
            driver = random.choice(drivers)
            driver.kill()
            driver.start()
            kill_count += 1
    return kill_count, time.monotonic() - begun_s


def _items(cp: RealNodes, plural: str) -> list[Json]:
    items: list[Json] = cp.api.get(f"/api/v1/namespaces/{NAMESPACE}/{plural}")["items"]
    return items


def main(argv: Sequence[str] | None = None) -> int:
    arguments = _parser().parse_args(argv)
    try:
        prerequisites.require()
    except UnavailableError as problem:
        print(problem, file=sys.stderr)
        return 1
    devices = {node: devices_of(node, arguments.devices // len(NODES)) for node in NODES}
    with RealNodes([robot(node, devices=devices[node]) for node in NODES], cdi=True) as cp:
        install(cp, values={"agent": {"driver": {"enabled": True}}})
        drivers = [driver_on(cp, node) for node in NODES]
        for driver in drivers:
            driver.start()
        scheduler = start_scheduler(cp)
        try:
            for node in NODES:
                if not wait_published(cp, node, *(device.id for device in devices[node])):
                    raise SystemExit(f"{node} does not publish its devices, see {cp.logs_dir}")
            with created(cp, NAMESPACE):
                cp.kubectl("label", "namespace", NAMESPACE, "pod-security.kubernetes.io/enforce=restricted")
                kills, seconds = race(
                    cp, drivers, pods=arguments.pods, kills=arguments.kills, within_s=arguments.within
                )
                count = sum(map(len, devices.values()))
                result = judge(_items(cp, "pods"), _items(cp, "events"), devices=count, kills=kills, seconds=seconds)
        finally:
            for program in (scheduler, *drivers):
                program.kill()
    save(arguments.json, asdict(result))
    print(summarise(result))
    return 1 if result.problems else 0


def summarise(result: Result) -> str:
    """The figures in a line, and a line for every problem."""
    shares = ", ".join(
        f"{scheduler}: {result.ran.get(scheduler, 0)} ran, {result.refused.get(scheduler, 0)} refused at first"
        for scheduler in SCHEDULERS
    )
    first = (
        f"{result.pods} pods, {result.devices} devices ({result.devices_used} used), {result.kills} kills of drivers, "
        f"{result.seconds:g} s; {shares}; {len(result.problems)} problems"
    )
    return "\n".join([first, *result.problems])


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="scripts/bench device_race", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--pods", type=options.count(2, 1000), default=200, help="each with a claim of its own (200)")
    parser.add_argument("--devices", type=options.count(2, 100), default=20, help="on the two nodes together (20)")
    parser.add_argument("--kills", type=options.count(0, 1000), default=0, help="of the nodes' drivers, at random (0)")
    parser.add_argument("--within", type=options.amount, default=900.0, metavar="SECONDS", help="all ended (900)")
    parser.add_argument("--json", type=options.report, help="write the figures to this file")
    return parser


if __name__ == "__main__":
    sys.exit(main())
