"""Throws random objects at a running product and watches whether it stays well."""

import random
import re
import secrets
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from tests.support.fuzz.generator import Generator
from tests.support.process_use import usage
from tests.support.world import APIS, World, plain_app

from robotapp_api.model.names import Annotation
from robotapp_api.model.robotapp import RobotApp
from robotapp_api.model.telemetry import NodeTelemetry
from robotapp_api.schema.crd import schema_of
from robotapp_testbed.failures import ApiStatusError
from robotapp_testbed.servers import answers

LOT = 25
TRACE = re.compile(r"Traceback \(most recent call last\)|\bcontroller_bug\b")
WITHIN_S = 60.0


@dataclass(slots=True)
class Report:
    """`sent` objects by kind and outcome; `ready_s` of the healthy app beside each lot; `problems` in words."""

    sent: Counter[str] = field(default_factory=Counter)
    ready_s: list[float] = field(default_factory=list)
    slowest_answer_s: float = 0.0
    problems: list[str] = field(default_factory=list)
    use: dict[str, Any] = field(default_factory=dict)

    @property
    def objects(self) -> int:
        return sum(self.sent.values())


class Campaign:
    """`seed` decides every object but its name; healthy apps take their domains from `pool`. The world's own processes are watched."""

    def __init__(self, world: World, *, seed: int, pool: str) -> None:
        self._world = world
        self._pool = pool
        self._make = Generator(seed)
        self._random = random.Random(seed)
        self._apps = schema_of(RobotApp)
        self._telemetry = schema_of(NodeTelemetry)["properties"]["status"]
        self._pids = {"operator": world.operator.pid, "scheduler": world.scheduler.pid}
        self.report = Report()

    def run(self, objects: int, *, tell: Callable[[Report], None] = lambda _: None) -> Report:
        """Send that many, in lots; after each lot a healthy app must become Ready, and `tell` gets what is so far."""
        with self._answers():
            while self.report.objects < objects and not self.report.problems:
                self._lot(min(LOT, objects - self.report.objects))
                tell(self.report)
        self._check()
        return self.report

    def _lot(self, count: int) -> None:
        makers = (self._app, self._app, self._app, self._edit, self._pod, self._node_telemetry)
        names: list[str] = []
        for number in range(count):
            kind, outcome = makers[number % len(makers)](names)
            self.report.sent[f"{kind} {outcome}"] += 1
        healthy = f"healthy-{secrets.token_hex(3)}"
        sent_s = self._world.create(plain_app(healthy, ros2={"pool": self._pool}))
        try:
            self.report.ready_s.append(self._world.watch.until_ready(healthy, within_s=WITHIN_S) - sent_s)
        except TimeoutError as late:
            self.report.problems.append(f"a healthy app was not Ready: {late}")
        self._world.cp.api.delete(f"/api/v1/namespaces/{self._world.namespace}/pods")
        self._world.clear()
        self._check()

    def _app(self, names: list[str]) -> tuple[str, str]:
        name = f"fuzz-{secrets.token_hex(4)}"
        outcome = self._tried(lambda: self._world.create(self._make.app(self._apps, name)))
        if outcome == "accepted":
            names.append(name)
        return "RobotApp", outcome

    def _edit(self, names: list[str]) -> tuple[str, str]:
        if not names:
            return self._app(names)
        spec = self._make.app(self._apps, "x")["spec"]
        path = f"{self._world.apps_path}/{names[-1]}"
        return "edit", self._tried(lambda: self._world.cp.api.patch(path, {"spec": spec}))

    def _pod(self, _: list[str]) -> tuple[str, str]:
        keys = (
            Annotation.POLICIES,
            Annotation.TOPOLOGY,
            Annotation.AFFINITY,
            Annotation.SHARED_DATA,
            Annotation.DDS_DOMAIN,
        )
        texts = {str(key): self._json() for key in keys if self._random.random() < 0.5}
        body = {
            "apiVersion": "v1",
            "kind": "Pod",
            "metadata": {"name": f"fuzz-{secrets.token_hex(4)}", "annotations": texts},
            "spec": {"schedulerName": "ros-aware-scheduler", "containers": [{"name": "c", "image": "x"}]},
        }
        path = f"/api/v1/namespaces/{self._world.namespace}/pods"
        return "pod", self._tried(lambda: self._world.cp.api.create(path, body))

    def _json(self) -> str:
        found = self._make.value({"type": "string", "maxLength": 200})
        return (
            f'{{"latency_budget": "{found}", "peer_pods": ["{found}"]}}' if self._random.random() < 0.5 else str(found)
        )

    def _node_telemetry(self, _: list[str]) -> tuple[str, str]:
        node = next(iter(self._world.nodes)).name
        status = self._make.value(self._telemetry)
        path = f"{APIS}/nodetelemetries/{node}/status"
        return "telemetry", self._tried(lambda: self._world.cp.api.patch(path, {"status": status}))

    @staticmethod
    def _tried(send: Any) -> str:
        try:
            send()
        except ApiStatusError as refused:
            return "refused" if refused.status in (400, 403, 409, 413, 422) else f"answered with {refused.status}"
        return "accepted"

    def _check(self) -> None:
        """Processes live on, and no log has a traceback."""
        for name, process in (("operator", self._world.operator), ("scheduler", self._world.scheduler)):
            if not process.running or process.pid != self._pids[name]:
                self.report.problems.append(f"{name} ended with {process.returncode}")
            found = TRACE.search(process.log_text())
            if found:
                at = process.log_text()[max(0, found.start() - 200) : found.start() + 2000]
                self.report.problems.append(f"{name} logged: {at}")
            self.report.use[name] = usage(process)

    @contextmanager
    def _answers(self) -> Iterator[None]:
        """Meanwhile ask the operator whether it lives: a loop that is held answers late."""
        stop = threading.Event()
        thread = threading.Thread(target=self._ask, args=(stop,), daemon=True)
        thread.start()
        try:
            yield
        finally:
            stop.set()
            thread.join()

    def _ask(self, stop: threading.Event) -> None:
        url = self._world.operator.health_url
        while not stop.wait(0.1):
            began_s = time.monotonic()
            answers(f"{url}/livez")  # a refusal or a timeout counts with its time, too
            self.report.slowest_answer_s = max(self.report.slowest_answer_s, time.monotonic() - began_s)


def as_json(report: Report) -> Mapping[str, Any]:
    ready = sorted(report.ready_s)
    return {
        "objects": report.objects,
        "sent": dict(sorted(report.sent.items())),
        "healthy_ready_s": {"median": ready[len(ready) // 2], "most": ready[-1]} if ready else {},
        "slowest_livez_s": round(report.slowest_answer_s, 3),
        "use": report.use,
        "problems": report.problems,
    }
