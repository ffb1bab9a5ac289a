"""Throws random objects at a running product and watches whether it stays well."""

import random
import re
import secrets
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from statistics import median
from typing import Any, Final

from tests.support.rigel.cases import ENVIRONMENT, first_generation, mutated

from campaigns.common.background import Background
from campaigns.common.process_use import queued_s, tree, tree_rss_bytes, usage
from campaigns.fuzz.generator import Generator
from campaigns.rigs.simulated_site import APIS, Object, SimulatedSite, plain_app
from rigel_bridge.document.failures import BridgeError
from rigel_bridge.document.tree import parse
from rigel_bridge.generations.load import load
from rigel_bridge.generations.model import Options
from rigel_bridge.render.app import Naming, Rendered, render
from robotapp_api.model.app.robotapp import RobotApp
from robotapp_api.model.claim import RobotClaim
from robotapp_api.model.names import API_VERSION, Annotation
from robotapp_api.model.telemetry import NodeTelemetry
from robotapp_api.schema.crd import schema_of
from robotapp_claims.rules.identity import claim_name_device, claim_name_domain
from robotapp_testbed import Process, wait_until
from robotapp_testbed.control_plane.servers import answers
from robotapp_testbed.failures import ApiStatusError

PATH: Final = f"{APIS}/robotclaims"
LABELS: Final = {"fuzz": "claim"}
_LISTED: Final = f"{PATH}?labelSelector=fuzz%3Dclaim"
SENTINEL_ID: Final = 101


class Claims:
    """`living` names an app of the site that is there now, "" when there is none."""

    def __init__(
        self, site: SimulatedSite, make: Generator, *, seed: int, pool: str, living: Callable[[], str]
    ) -> None:
        schema = schema_of(RobotClaim)["properties"]
        self._site = site
        self._make = make
        self._random = random.Random(seed)
        self._pool = pool
        self._living = living
        self._spec, self._status = schema["spec"], schema["status"]
        self._sentinel = ""

    def create(self) -> None:
        """One more; every third gets a random status, too. Raises `ApiStatusError` where it is refused."""
        body = self.object()
        self._site.cp.api.create(PATH, body)
        if self._random.random() < 1 / 3:
            status = self._make.value(self._status)
            self._site.cp.api.patch(f"{PATH}/{body['metadata']['name']}/status", {"status": status})

    def object(self) -> Object:
        spec = self._make.value({**self._spec, "required": ["domain", "device", "holder"]})
        if self._random.random() < 0.9:  # exactly one, or the API server refuses it
            self._mend(spec)
        name = _name_of(spec) if self._random.random() < 0.7 else f"fuzz-{secrets.token_hex(4)}"
        return _body(name, spec, LABELS)

    def _mend(self, spec: Object) -> None:
        spec.pop(self._random.choice(("domain", "device")))
        domain = spec.get("domain")
        if domain:
            domain["scopeValue"] = "" if domain["scope"] == "Cluster" else self._random.choice(("hall-1", "nowhere"))
            domain["pool"] = self._random.choice((self._pool, "nowhere", domain["pool"]))
        else:
            spec["device"]["node"] = self._random.choice((next(iter(self._site.nodes)).name, "nowhere"))
        holder = spec["holder"]
        namespace = self._site.namespace
        match self._random.randrange(4):
            case 0:  # of nobody any more
                holder |= _app_holder(namespace, "gone", secrets.token_hex(16))
            case 1 if name := self._living():
                holder |= _app_holder(namespace, name, self._site.app(name)["metadata"]["uid"])
            case 2:
                uid = secrets.token_hex(16)
                holder |= {"apiVersion": "v1", "kind": "Pod", "namespace": namespace, "name": "gone", "uid": uid}

    def begin(self) -> None:
        """A claim of an app that is gone, which the sweep must find beside all others."""
        domain = {"pool": self._pool, "scope": "Cluster", "scopeValue": "", "id": SENTINEL_ID}
        spec = {"domain": domain, "holder": _app_holder(self._site.namespace, "sentinel", secrets.token_hex(16))}
        name = claim_name_domain(self._pool, "Cluster", "", SENTINEL_ID)
        try:
            self._site.cp.api.create(PATH, _body(name, spec, {}))
            self._sentinel = name
        except ApiStatusError as error:
            if error.status != 409:  # one of the random ones took its id
                raise
            self._sentinel = ""

    @property
    def swept(self) -> bool:
        """Is the claim of `begin` gone?"""
        if not self._sentinel:
            return True
        try:
            found = self._site.cp.api.get(f"{PATH}/{self._sentinel}")
        except ApiStatusError as error:
            if error.status == 404:
                return True
            raise
        return bool(found["spec"]["holder"]["name"] != "sentinel")

    def clear(self) -> None:
        """Those that nothing ends: of holders of unknown kinds, and parked ones."""
        self._site.cp.api.delete(_LISTED)


def _body(name: str, spec: Object, labels: dict[str, str]) -> Object:
    return {"apiVersion": API_VERSION, "kind": "RobotClaim", "metadata": {"name": name, "labels": labels}, "spec": spec}


def _app_holder(namespace: str, name: str, uid: str) -> dict[str, Any]:
    return {"apiVersion": API_VERSION, "kind": "RobotApp", "namespace": namespace, "name": name, "uid": uid}


def _name_of(spec: Object) -> str:
    """The name that the thing has, as far as a name can have it."""
    if domain := spec.get("domain"):
        return claim_name_domain(domain["pool"], domain["scope"], domain.get("scopeValue", ""), domain["id"])
    return claim_name_device(spec["device"]["node"], spec["device"]["id"])


READY_S: Final = 2.0
"""In half of the cases a healthy app is Ready as soon, on a machine that does nothing else."""
READY_TIMES: Final = 5.0
"""On a busy machine it may take so many times as long as bare Deployments of as many pods, bound by hand, in the same minute.
An app has two discovery servers more, which come first, a claim and a status."""
HELD_S: Final = 1.0
"""For no longer may anything hold the loop of operator or scheduler. Time in which it had no processor does not count."""
BARE_S: Final = 0.85
"""What bare Deployments take beside 5,000 objects on two cores that do nothing else (median). Where they take longer, an answer may, too: not all that keeps a program waiting
on a busy machine is counted by the kernel as waiting for a processor."""
WARM_SHARE: Final = 0.25
"""Share of the objects after which a process has imported, cached and allocated what it needs for any of them."""
KEPT_BYTES: Final = 2048
"""Growth per object that is gone again: an event's text, a key that is forgotten every ten minutes."""
NOISE_BYTES: Final = 16 << 20
"""Growth that says nothing: what the allocator keeps of the lot that was largest so far."""
CACHES_BYTES: Final[Mapping[str, int]] = {"scheduler": 24 << 20}
"""What fills up and has a bound of its own: the scheduler's explain records take 20 MB at most."""
LOTS: Final = 3
"""Memory is the median of as many lots."""


@dataclass(slots=True)
class Samples:
    """Of one process: objects sent so far and bytes in RAM then. `caches_bytes`: of caches that fill up to a bound of their own."""

    caches_bytes: int = 0
    objects: list[int] = field(default_factory=list)
    rss_bytes: list[int] = field(default_factory=list)

    @property
    def warm(self) -> int:
        """How many lots are warm-up."""
        return min(max(1, round(WARM_SHARE * len(self.objects))), max(0, len(self.objects) - 2))

    @property
    def since_warm(self) -> tuple[int, float]:
        """Objects after warm-up, and by how much the process has grown over them."""
        after, last = self.rss_bytes[self.warm :][:LOTS], self.rss_bytes[-LOTS:]
        if not after:
            return 0, 0.0
        return self.objects[-1] - self.objects[self.warm], median(last) - median(after)

    @property
    def allowed_bytes(self) -> int:
        return NOISE_BYTES + self.caches_bytes + KEPT_BYTES * self.since_warm[0]


def memory_problems(samples: Mapping[str, Samples]) -> Iterator[str]:
    for name, found in samples.items():
        objects, grown = found.since_warm
        if grown > found.allowed_bytes:
            yield f"{name} grew by {grown / 1e6:.1f} MB over {objects} objects, allowed are {found.allowed_bytes / 1e6:.1f}"


def time_problems(
    ready_s: Sequence[float], slowest_s: Mapping[str, float], *, bare_s: Sequence[float]
) -> Iterator[str]:
    """`bare_s`: of bare Deployments beside each healthy app. `slowest_s`: the longest that each process took to answer."""
    most_s = max(READY_S, READY_TIMES * median(bare_s)) if bare_s else READY_S
    if ready_s and median(ready_s) > most_s:
        yield f"healthy apps were Ready after {median(ready_s):.2f} s (median), allowed are {most_s:.2f}"
    held_s = HELD_S * max(1.0, median(bare_s) / BARE_S) if bare_s else HELD_S
    for name, seconds in slowest_s.items():
        if seconds > held_s:
            yield f"the {name} took {seconds:.2f} s to answer, allowed are {held_s:.2f}"


PULSE_S: Final = 0.05


class Pulse(Background):
    """A thread that does nothing: while it comes late, this process or the whole machine stood still."""

    def __init__(self) -> None:
        self._late: deque[tuple[float, float]] = deque(maxlen=100_000)
        super().__init__("pulse")

    def late_s(self, since_s: float) -> float:
        """Seconds by which it came too late since then (monotonic), all together."""
        return sum(late_s for at_s, late_s in list(self._late) if at_s >= since_s)

    def _run(self) -> None:
        before_s = time.monotonic()
        while not self._stop.wait(PULSE_S):
            now_s = time.monotonic()
            self._late.append((now_s, max(0.0, now_s - before_s - PULSE_S)))
            before_s = now_s


def ask(process: Process, pulse: Pulse) -> tuple[float, float]:
    """Seconds until /livez was answered (or refused, or given up), and for how many of them the process itself held it up."""
    pids = tree(process.pid)
    queued_before_s, began_s = queued_s(pids), time.monotonic()
    answers(f"{process.health_url}/livez")
    took_s = time.monotonic() - began_s
    return took_s, max(0.0, took_s - (queued_s(pids) - queued_before_s) - pulse.late_s(began_s))


LOT = 25
TRACE = re.compile(r"Traceback \(most recent call last\)|\bcontroller_bug\b")
WITHIN_S = 60.0
AS_DRAWN = 0.3
"""Share of Rigelfiles that are sent as the first draw has them."""
MOST_DRAWN = 40
BARE = 3
"""Deployments of one pod, as many as a healthy app has components."""


@dataclass(slots=True)
class Report:
    """`sent` objects by kind and outcome; `ready_s` of the healthy app beside each lot; `problems` in words.

    `slowest_answer_s` and `memory` are by process.
    """

    sent: Counter[str] = field(default_factory=Counter)
    ready_s: list[float] = field(default_factory=list)
    slowest_answer_s: dict[str, float] = field(default_factory=dict)
    """Without the time in which the process had no processor."""
    slowest_wait_s: dict[str, float] = field(default_factory=dict)
    """With it."""
    bare_s: list[float] = field(default_factory=list)
    """Of bare Deployments of as many pods, beside each healthy app."""
    memory: dict[str, Samples] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    use: dict[str, Any] = field(default_factory=dict)

    @property
    def objects(self) -> int:
        return sum(self.sent.values())


class Campaign:
    """`seed` decides every object but its name; healthy apps take their domains from `pool`. The site's own processes are watched."""

    def __init__(self, site: SimulatedSite, *, seed: int, pool: str) -> None:
        self._site = site
        self._pool = pool
        self._make = Generator(seed)
        self._random = random.Random(seed)
        self._apps = schema_of(RobotApp)
        self._telemetry = schema_of(NodeTelemetry)["properties"]["status"]
        self._processes = {"operator": site.operator, "scheduler": site.scheduler}
        self._pids = {name: process.pid for name, process in self._processes.items()}
        self._beside = ThreadPoolExecutor(1)
        self._living: list[str] = []
        living = lambda: self._living[-1] if self._living else ""  # noqa: E731
        self._claims = Claims(site, self._make, seed=seed, pool=pool, living=living)
        self.report = Report(memory={name: Samples(CACHES_BYTES.get(name, 0)) for name in self._processes})

    def run(self, objects: int, *, tell: Callable[[Report], None] = lambda _: None) -> Report:
        """Send that many, in lots; after each lot a healthy app must become Ready, and `tell` gets what is so far."""
        with self._answers():
            while self.report.objects < objects and not self.report.problems:
                self._lot(min(LOT, objects - self.report.objects))
                tell(self.report)
        self._check()
        self.report.problems += memory_problems(self.report.memory)
        self.report.problems += time_problems(
            self.report.ready_s, self.report.slowest_answer_s, bare_s=self.report.bare_s
        )
        return self.report

    def _lot(self, count: int) -> None:
        makers = (
            self._app,
            self._rigelfile,
            self._app,
            self._edit,
            self._claim,
            self._pod,
            self._app,
            self._claim,
            self._node_telemetry,
        )
        names: list[str] = []
        self._living = names
        self._claims.begin()
        for number in range(count):
            kind, outcome = makers[number % len(makers)](names)
            self.report.sent[f"{kind} {outcome}"] += 1
        healthy = f"healthy-{secrets.token_hex(3)}"
        bare = self._beside.submit(self._bare)
        sent_s = self._site.create(plain_app(healthy, ros2={"pool": self._pool}))
        try:
            self.report.ready_s.append(self._site.watch.until_ready(healthy, within_s=WITHIN_S) - sent_s)
        except TimeoutError as late:
            self.report.problems.append(f"a healthy app was not Ready: {late}")
        self.report.bare_s.append(bare.result())
        if not wait_until(lambda: self._claims.swept, timeout_s=WITHIN_S, poll_s=0.2):
            self.report.problems.append(f"the claim of an app that is gone was not swept within {WITHIN_S:.0f} s")
        self._claims.clear()
        for kind in ("pods", "persistentvolumeclaims"):
            self._site.cp.api.delete(f"/api/v1/namespaces/{self._site.namespace}/{kind}")
        self._site.clear()
        self._check()

    def _app(self, names: list[str]) -> tuple[str, str]:
        name = f"fuzz-{secrets.token_hex(4)}"
        outcome = self._tried(lambda: self._site.create(self._make.app(self._apps, name)))
        if outcome == "accepted":
            names.append(name)
        return "RobotApp", outcome

    def _edit(self, names: list[str]) -> tuple[str, str]:
        if not names:
            return self._app(names)
        spec = self._make.app(self._apps, "x")["spec"]
        path = f"{self._site.apps_path}/{names[-1]}"
        return "edit", self._tried(lambda: self._site.cp.api.patch(path, {"spec": spec}))

    def _bare(self) -> float:
        """Seconds until bare Deployments run whose pods name their node: what the machine needs for it in this minute."""
        api, path = self._site.cp.api, f"/apis/apps/v1/namespaces/{self._site.namespace}/deployments"
        node = next(node.name for node in self._site.nodes if not node.robot)
        names = [f"bare-{secrets.token_hex(3)}" for _ in range(BARE)]
        began_s = time.monotonic()
        api.each(lambda name: api.create(path, _bare_deployment(name, node)), names)

        def run() -> bool:
            return all(api.get(f"{path}/{name}").get("status", {}).get("readyReplicas") == 1 for name in names)

        wait_until(run, timeout_s=WITHIN_S, poll_s=0.05)
        took_s = time.monotonic() - began_s
        api.each(lambda name: api.delete(f"{path}/{name}"), names)
        return took_s

    def _claim(self, _: list[str]) -> tuple[str, str]:
        return "RobotClaim", self._tried(self._claims.create)

    def _rigelfile(self, names: list[str]) -> tuple[str, str]:
        """A Rigelfile, and what the bridge makes of it. Three of four random ones make nothing, so most are drawn again."""
        tries = 1 if self._random.random() < AS_DRAWN else MOST_DRAWN
        maker = _well_formed if self._random.random() < 2 / 3 else mutated
        found: list[Rendered] = []
        for seed in (self._random.randrange(2**31) for _ in range(tries)):
            try:
                found = _bridged(maker(seed))
            except BridgeError:
                continue
            except Exception as error:  # noqa: BLE001 - that is what is looked for
                self.report.problems.append(f"the bridge ended with {type(error).__name__} ({error}): {maker} {seed}")
                return "Rigelfile", "ended the bridge"
            break
        outcomes = [self._rendered(one, names) for one in found] or ["refused"]
        return "Rigelfile", next((each for each in outcomes if each != "accepted"), "accepted")

    def _rendered(self, one: Rendered, names: list[str]) -> str:
        name = f"fuzz-{secrets.token_hex(4)}"
        path = f"/api/v1/namespaces/{self._site.namespace}/persistentvolumeclaims"

        def send() -> None:
            for number, claim in enumerate(one.claims):
                self._site.cp.api.create(path, {**claim, "metadata": {"name": f"{name}-{number}"}})
            self._site.create({**one.app, "metadata": {**one.app["metadata"], "name": name}})

        outcome = self._tried(send)
        if outcome == "accepted":
            names.append(name)
        return outcome

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
        path = f"/api/v1/namespaces/{self._site.namespace}/pods"
        return "pod", self._tried(lambda: self._site.cp.api.create(path, body))

    def _json(self) -> str:
        found = self._make.value({"type": "string", "maxLength": 200})
        return (
            f'{{"latency_budget": "{found}", "peer_pods": ["{found}"]}}' if self._random.random() < 0.5 else str(found)
        )

    def _node_telemetry(self, _: list[str]) -> tuple[str, str]:
        node = next(iter(self._site.nodes)).name
        status = self._make.value(self._telemetry)
        path = f"{APIS}/nodetelemetries/{node}/status"
        return "telemetry", self._tried(lambda: self._site.cp.api.patch(path, {"status": status}))

    @staticmethod
    def _tried(send: Any) -> str:
        try:
            send()
        except ApiStatusError as refused:
            return "refused" if refused.status in (400, 403, 409, 413, 422) else f"answered with {refused.status}"
        return "accepted"

    def _check(self) -> None:
        """Processes live on, and no log has a traceback."""
        for name, process in self._processes.items():
            if not process.running or process.pid != self._pids[name]:
                self.report.problems.append(f"{name} ended with {process.returncode}")
            found = TRACE.search(process.log_text())
            if found:
                at = process.log_text()[max(0, found.start() - 200) : found.start() + 2000]
                self.report.problems.append(f"{name} logged: {at}")
            self.report.use[name] = usage(process)
            self.report.memory[name].objects.append(self.report.objects)
            self.report.memory[name].rss_bytes.append(tree_rss_bytes(process.pid))

    @contextmanager
    def _answers(self) -> Iterator[None]:
        """Meanwhile ask operator and scheduler whether they live: a loop that is held answers late.

        The scheduler's port is a process of its own, which passes this question on to the loop that places pods.
        """
        stop, pulse = threading.Event(), Pulse()
        threads = [
            threading.Thread(target=self._ask, args=(name, process, pulse, stop), daemon=True)
            for name, process in self._processes.items()
        ]
        with pulse:
            for thread in threads:
                thread.start()
            try:
                yield
            finally:
                stop.set()
                for thread in threads:
                    thread.join()

    def _ask(self, name: str, process: Process, pulse: Pulse, stop: threading.Event) -> None:
        report = self.report
        while not stop.wait(0.1):
            took_s, held_s = ask(process, pulse)
            report.slowest_wait_s[name] = max(report.slowest_wait_s.get(name, 0.0), took_s)
            report.slowest_answer_s[name] = max(report.slowest_answer_s.get(name, 0.0), held_s)


def _well_formed(seed: int) -> bytes:
    return first_generation(seed).encode()


def _bridged(content: bytes) -> list[Rendered]:
    """Raises BridgeError."""
    rigelfile = load(parse(content, "Rigelfile"), Options(environment=ENVIRONMENT))
    return [render(target, Naming("fuzz", override=False)) for target in rigelfile.targets]


def _bare_deployment(name: str, node: str) -> dict[str, Any]:
    labels = {"bare": name}
    spec = {"nodeName": node, "containers": [{"name": "c", "image": "x"}]}
    return {
        "apiVersion": "apps/v1",
        "kind": "Deployment",
        "metadata": {"name": name},
        "spec": {
            "selector": {"matchLabels": labels},
            "template": {"metadata": {"labels": labels}, "spec": spec},
        },
    }


def as_json(report: Report) -> Mapping[str, Any]:
    ready = sorted(report.ready_s)
    return {
        "objects": report.objects,
        "sent": dict(sorted(report.sent.items())),
        "healthy_ready_s": {"median": ready[len(ready) // 2], "most": ready[-1]} if ready else {},
        "slowest_wait_for_livez_s": {name: round(seconds, 3) for name, seconds in report.slowest_wait_s.items()},
        "slowest_livez_s": {name: round(seconds, 3) for name, seconds in report.slowest_answer_s.items()},
        "bare_deployments_ready_s": round(median(report.bare_s), 2) if report.bare_s else None,
        "grown_mb": {name: round(found.since_warm[1] / 1e6, 1) for name, found in report.memory.items()},
        "objects_after_warm_up": {name: found.since_warm[0] for name, found in report.memory.items()},
        "use": report.use,
        "problems": report.problems,
    }
