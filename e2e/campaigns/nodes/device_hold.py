"""A RobotApp's pod is replaced many times on a real node, and its driver killed: it keeps its device, which a waiting rival never gets.

The holder's program opens its serial port after every replacement. In the end the holder's app is deleted and the rival must run.
Needs root.
"""

import argparse
import random
import statistics
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import Any, Final

from campaigns.common import options
from campaigns.common.output import save, say
from campaigns.nodes.claims import driver_on, wait_published
from campaigns.nodes.real_pods import component, shell
from robotapp_api.model.names import API_VERSION, Label
from robotapp_testbed import wait_until
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.control_plane.product import install, start_operator, start_scheduler
from robotapp_testbed.machines.nodes import Device, robot
from robotapp_testbed.processes.process import Process
from robotapp_testbed.real import RealNodes, UnavailableError, prerequisites

Json = dict[str, Any]
NODE: Final = "robot-1"
NAMESPACE: Final = "device-hold"
HOLDER, RIVAL = "holder", "rival"
ARM: Final = Device("serial-0403-6001-a50285bi", "serial", identity="0403:6001:A50285BI")
TALK: Final = 'exec 3<>/dev/arm && echo "$HOSTNAME" >&3 && read line <&3 && test "$line" = "$HOSTNAME" && echo heard'
RUNNING_S: Final = 90.0
KILL_S: Final = 2.0
"""At most so long between two kills."""


@dataclass(frozen=True, slots=True)
class Result:
    """Figures that `--json` writes. Seconds are from the deletion of a pod until its successor had opened the device."""

    replacements: int
    kills: int
    median_s: float
    longest_s: float
    rival_ran_s: float | None
    """After the holder's app was deleted; None when it did not run."""
    rival_story: list[str]
    """What happened to the rival from then on, with times of day: conditions of its pod, and events about it."""
    problems: list[str]


def robotapp(name: str) -> Json:
    """An app of one component with the node's one serial port, as a pod that ends at once."""
    device = {"name": "arm", "type": "serial", "mountAs": "/dev/arm"}
    driver = component("driver", devices=[device], command=["sh"])
    spec = {"ros": {"distro": "humble"}, "components": [driver]}
    return {"apiVersion": API_VERSION, "kind": "RobotApp", "metadata": {"name": name}, "spec": spec}


class Killer(threading.Thread):
    """Ends the driver with SIGKILL at random moments and starts it again at once."""

    def __init__(self, driver: Process, kills: int) -> None:
        super().__init__(daemon=True)
        self._driver = driver
        self._kills = kills
        self._over = threading.Event()
        self.killed = 0

    def run(self) -> None:
        while self.killed < self._kills and not self._over.wait(random.uniform(0.1, KILL_S)):
            self._driver.kill()
            self._driver.start()
            self.killed += 1

    def end(self) -> None:
        self._over.set()
        self.join()


def pods_of(cp: RealNodes, app: str) -> list[Json]:
    items: list[Json] = cp.api.get(f"/api/v1/namespaces/{NAMESPACE}/pods?labelSelector={Label.APP}={app}")["items"]
    return items


def await_running(cp: RealNodes, app: str, *, but: str = "") -> str:
    """The name of the app's Running pod that is not about to end and is another one than `but`; "" if there is none in time."""
    names: list[str] = []

    def look() -> bool:
        names[:] = [
            pod["metadata"]["name"]
            for pod in pods_of(cp, app)
            if pod["status"].get("phase") == "Running" and "deletionTimestamp" not in pod["metadata"]
        ]
        return any(name != but for name in names)

    return next(name for name in names if name != but) if wait_until(look, timeout_s=RUNNING_S, poll_s=0.1) else ""


def started(pod: Json) -> bool:
    """Returns whether a container of the pod was ever started."""
    return any("containerID" in status for status in pod["status"].get("containerStatuses") or ())


def replace(cp: RealNodes, before: str) -> str:
    """Deletes the holder's pod. Returns the name of its successor, "" when that does not run or cannot use the device."""
    cp.kubectl("delete", "pod", before, "-n", NAMESPACE, "--wait=false")
    after = await_running(cp, HOLDER, but=before)
    return after if after and shell(cp, NAMESPACE, after, TALK, check=False) == "heard\n" else ""


def hold(cp: RealNodes, driver: Process, *, replacements: int, kills: int) -> Result:
    """Replaces the holder's pod so often, then lets the rival have its turn."""
    problems: list[str] = []
    times: list[float] = []
    cp.kubectl("apply", "-n", NAMESPACE, "-f", "-", stdin=[robotapp(HOLDER)])
    name = await_running(cp, HOLDER)
    if not name:
        raise SystemExit(cp.kubectl("get", "robotapp,resourceclaim,pod", "-n", NAMESPACE, "-o", "yaml"))
    cp.kubectl("apply", "-n", NAMESPACE, "-f", "-", stdin=[robotapp(RIVAL)])
    killer = Killer(driver, kills)
    killer.start()
    try:
        while len(times) < replacements or (killer.killed < kills and len(times) < 2 * replacements):
            begun_s = time.monotonic()
            after = replace(cp, name)
            times.append(time.monotonic() - begun_s)
            if not after:
                problems.append(f"after {name}: no pod that can use the device within {RUNNING_S:g} s")
                break
            name = after
            problems += [f"rival {pod['metadata']['name']} was started" for pod in pods_of(cp, RIVAL) if started(pod)]
            if len(times) % 10 == 0:
                say(f"{len(times)} replacements, {killer.killed} kills, {len(problems)} problems")
    finally:
        killer.end()
    cp.kubectl("delete", "robotapp", HOLDER, "-n", NAMESPACE, "--cascade=foreground")
    begun_s, begin = time.monotonic(), time.strftime("%H:%M:%SZ", time.gmtime())
    rival = await_running(cp, RIVAL)
    rival_ran_s = round(time.monotonic() - begun_s, 2) if rival else None
    if not rival or shell(cp, NAMESPACE, rival, TALK, check=False) != "heard\n":
        problems.append("the rival cannot use the device when the holder is gone")
    return Result(
        replacements=len(times),
        kills=killer.killed,
        median_s=round(statistics.median(times), 2),
        longest_s=round(max(times), 2),
        rival_ran_s=rival_ran_s,
        rival_story=[f"{begin} the holder's app is gone", *(tell_of(cp, rival) if rival else ())],
        problems=problems,
    )


def tell_of(cp: RealNodes, name: str) -> list[str]:
    """Lists what happened to a pod, oldest first; the API server keeps whole seconds."""
    (pod,) = [pod for pod in pods_of(cp, RIVAL) if pod["metadata"]["name"] == name]
    moments = [
        (condition["lastTransitionTime"], f"{condition['type']}={condition['status']}")
        for condition in pod["status"]["conditions"]
    ]
    path = f"/apis/events.k8s.io/v1/namespaces/{NAMESPACE}/events?fieldSelector=regarding.name={name}"
    for event in cp.api.get(path)["items"]:
        moment_text = event.get("deprecatedLastTimestamp") or event.get("eventTime") or ""
        moments.append((moment_text, f"{event.get('reason')}: {event.get('note', '')[:200]}"))
    return [f"{moment.partition('T')[2]} {text}" for moment, text in sorted(moments)]


@contextmanager
def running(*programs: Process) -> Iterator[None]:
    try:
        yield
    finally:
        for program in programs:
            program.kill()


def main(argv: Sequence[str] | None = None) -> int:
    arguments = _parser().parse_args(argv)
    try:
        prerequisites.require()
    except UnavailableError as problem:
        print(problem, file=sys.stderr)
        return 1
    with RealNodes([robot(NODE, devices=[ARM])], cdi=True, kube_scheduler=False) as cp:
        install(cp, values={"agent": {"driver": {"enabled": True}}})
        driver = driver_on(cp, NODE)
        with running(driver, start_operator(cp), start_scheduler(cp)):
            driver.start()
            if not wait_published(cp, NODE, ARM.id):
                raise SystemExit(f"{NODE} does not publish its device, see {cp.logs_dir}")
            with created(cp, NAMESPACE):
                result = hold(cp, driver, replacements=arguments.replacements, kills=arguments.kills)
    print(
        f"{result.replacements} replacements in {result.median_s:g} s each (median; longest {result.longest_s:g}), "
        f"{result.kills} kills of the driver, rival ran {result.rival_ran_s} s after the holder was gone; "
        f"{len(result.problems)} problems"
    )
    print("\n".join([*result.rival_story, *result.problems]))
    save(arguments.json, asdict(result))
    return 1 if result.problems else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="scripts/bench device_hold", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--replacements", type=options.count(1, 1000), default=50, help="of the holder's pod (50)")
    parser.add_argument("--kills", type=options.count(0, 1000), default=30, help="of the driver, at random (30)")
    parser.add_argument("--json", type=options.report, help="write the figures to this file")
    return parser


if __name__ == "__main__":
    sys.exit(main())
