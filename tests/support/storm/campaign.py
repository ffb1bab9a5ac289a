"""Apps and pods come and go by the second while operators and schedulers are killed and strangers forge what they may."""

import random
import secrets
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from typing import Any

from tests.support.storm.history import Recorder, Verdict, judge
from tests.support.world import Object, World, plain_app

from robotapp_api.model.names import Annotation, Label
from robotapp_testbed import ControlPlane, Process, product, wait_until
from robotapp_testbed.failures import ApiStatusError
from robotapp_testbed.namespaces import created
from robotapp_testbed.topology import Device, fleet

DEVICES_PER_ROBOT = 5
KILL_EVERY_S = 20.0
CHURN = 0.1
"""Of what there is, this much goes each second, and as much comes."""
WAIT_S = 240.0


@dataclass(slots=True)
class Report:
    verdict: Verdict
    seconds: float
    kills: int
    forged: int
    lost: list[str] = field(default_factory=list)
    left: list[str] = field(default_factory=list)

    @property
    def problems(self) -> list[str]:
        return [*self.verdict.broken[:20], *self.lost, *self.left]


class Storm:
    """`wanted` apps and pods at a time for the domains of pool default and some devices. `seed` decides who comes, goes and dies."""

    def __init__(self, cp: ControlPlane, *, wanted: int, robots: int, seed: int) -> None:
        self._cp = cp
        self._wanted = wanted
        self._random = random.Random(seed)
        self._mark = secrets.token_hex(2)
        names = [f"amr-{self._mark}-{number}" for number in range(robots)]
        cans = [Device(f"can-can{i}", "can", interface=f"can{i}") for i in range(DEVICES_PER_ROBOT)]
        self._nodes = fleet(robots=names, edges=2, clouds=0, devices=dict.fromkeys(names, cans))
        self._there: list[tuple[str, str]] = []
        """(kind, name) of what was made and not deleted."""
        self._kills = self._forged = self._number = 0

    def run(self, grants: int) -> Report:
        """Until so many claims were made; then quiet, then nothing."""
        with ExitStack() as stack:
            world = stack.enter_context(World(self._cp, self._nodes, tidy=False))
            stranger = f"stranger-{self._mark}"
            stack.enter_context(created(self._cp, stranger))
            second = product.start_scheduler(self._cp, name="scheduler-2", sweep_seconds=1, lease_namespace=stranger)
            stack.callback(second.kill)
            processes = [world.operator, world.another_operator(), world.scheduler, second]
            recorder = stack.enter_context(Recorder(self._cp))
            began_s = time.monotonic()
            self._rage(world, recorder, processes, stranger, grants)
            report = Report(Verdict(), time.monotonic() - began_s, self._kills, self._forged)
            report.lost = self._lost(world)
            report.left = self._left(world, stranger)
        report.verdict = judge(recorder.events, namespaces={world.namespace})
        return report

    def _rage(self, world: World, recorder: Recorder, processes: list[Process], stranger: str, grants: int) -> None:
        kill_s = time.monotonic() + KILL_EVERY_S
        while recorder.claims < grants:
            round_s = time.monotonic()
            for _ in range(max(1, int(len(self._there) * CHURN))):
                if self._there:
                    self._delete(world, self._there.pop(self._random.randrange(len(self._there))))
            while len(self._there) < self._wanted:
                self._create(world)
            self._forge(world, stranger)
            if time.monotonic() >= kill_s:
                self._random.choice(processes).kill()
                self._kills += 1
                kill_s = time.monotonic() + KILL_EVERY_S
            for process in processes:
                if not process.running:
                    process.start()
            time.sleep(max(0.0, 1.0 - (time.monotonic() - round_s)))

    def _create(self, world: World) -> None:
        self._number += 1
        name = f"s-{self._number}"
        kind = self._random.choice(("app", "app", "device app", "pod"))
        if kind == "pod":
            self._cp.api.create(f"/api/v1/namespaces/{world.namespace}/pods", _pod(name))
        else:
            app = plain_app(name, parts=("only",))
            if kind == "device app":
                app["spec"]["components"][0]["devices"] = [{"name": "bus", "type": "can"}]
            world.create(app)
        self._there.append(("pods" if kind == "pod" else "robotapps", name))

    def _delete(self, world: World, what: tuple[str, str]) -> None:
        kind, name = what
        base = f"/api/v1/namespaces/{world.namespace}/pods" if kind == "pods" else world.apps_path
        with _gone_is_fine():
            self._cp.api.delete(f"{base}/{name}")

    def _forge(self, world: World, stranger: str) -> None:
        """A Deployment and a pod of another tenant that name an app of ours and a domain."""
        apps = [name for kind, name in self._there if kind == "robotapps"]
        if not apps:
            return
        with _gone_is_fine():
            uid = world.app(self._random.choice(apps))["metadata"]["uid"]
            self._forged += 1
            labels = {Label.APP_UID.value: uid, Label.INSTANCE.value: "", Label.APP.value: "x", "forged": "yes"}
            number = str(self._random.randint(1, 101))
            container = {"name": "c", "image": "x", "env": [{"name": "ROS_DOMAIN_ID", "value": number}]}
            self._cp.api.create(f"/apis/apps/v1/namespaces/{stranger}/deployments", _deployment(labels, container))
        if self._forged % 20 == 0:
            self._cp.api.delete(f"/apis/apps/v1/namespaces/{stranger}/deployments")

    def _lost(self, world: World) -> list[str]:
        """With fewer wishes than there is, everybody who stays must be served."""
        apps = [each for each in self._there if each[0] == "robotapps"]
        for what in [each for each in self._there if each not in apps[:20]]:
            self._delete(world, what)
        del self._there[:]
        kept = [name for _, name in apps[:20]]

        def waiting() -> list[str]:
            found = {each["metadata"]["name"]: each for each in self._cp.api.get(world.apps_path)["items"]}
            return [name for name in kept if not _served(found.get(name))]

        wait_until(lambda: not waiting(), timeout_s=WAIT_S, poll_s=0.5)
        return [f"{name} was never served: {world.app(name).get('status', {}).get('summary')}" for name in waiting()]

    def _left(self, world: World, stranger: str) -> list[str]:
        self._cp.api.delete(f"/apis/apps/v1/namespaces/{stranger}/deployments")
        self._cp.api.delete(world.apps_path)
        self._cp.api.delete(f"/api/v1/namespaces/{world.namespace}/pods")

        def left() -> list[str]:
            return [claim["metadata"]["name"] for claim in world.claims()]

        wait_until(lambda: not left(), timeout_s=WAIT_S, poll_s=0.5)
        return [f"claim {name} is left" for name in left()]


def _served(app: Object | None) -> bool:
    conditions = {each["type"]: each for each in (app or {}).get("status", {}).get("conditions", ())}
    return bool(conditions.get("Ready", {}).get("status") == "True")


def _pod(name: str) -> Object:
    return {
        "metadata": {"name": name, "annotations": {str(Annotation.DDS_DOMAIN): "auto"}},
        "spec": {
            "schedulerName": "ros-aware-scheduler",
            "containers": [{"name": "c", "image": "x"}],
            "terminationGracePeriodSeconds": 0,
        },
    }


def _deployment(labels: dict[str, str], container: dict[str, Any]) -> Object:
    template = {"metadata": {"labels": labels}, "spec": {"containers": [container]}}
    return {
        "apiVersion": "apps/v1",
        "kind": "Deployment",
        "metadata": {"generateName": "forged-", "labels": labels},
        "spec": {"replicas": 0, "selector": {"matchLabels": {"forged": "yes"}}, "template": template},
    }


@contextmanager
def _gone_is_fine() -> Iterator[None]:
    try:
        yield
    except ApiStatusError as error:
        if error.status not in (404, 409):
            raise
