"""Apps and pods come and go by the second while programs are killed, answers get lost and strangers forge what they may."""

import logging
import os
import random
import secrets
import time
from collections import defaultdict
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from campaigns.rigs.simulated_site import Object, SimulatedSite
from campaigns.storm import program
from campaigns.storm.churn import Churn, Wish, path_of
from campaigns.storm.forger import Forger
from campaigns.storm.history import Judge, Verdict
from campaigns.storm.program import LOST
from campaigns.storm.recorder import Recorder
from campaigns.storm.wishes import is_pod
from robotapp_api.model.names import API_VERSION, SCHEDULER_MANAGER, SYSTEM_NAMESPACE
from robotapp_testbed import ControlPlane, Process, wait_until
from robotapp_testbed.binaries.pins import REPOSITORY
from robotapp_testbed.control_plane import product
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.machines.topology import Device, fleet

STALL_S: Final = 60.0
STALL_WISHES: Final = 30
"""So many came since the last grant."""


class Stall:
    """`look` as often as you like; `clock` is monotonic seconds."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._grants = self._wishes = 0
        self._since_s = clock()

    def __repr__(self) -> str:
        return f"<Stall: {self._grants} grants>"

    def look(self, *, grants: int, wishes: int) -> str:
        """What to tell when nothing is granted any more, else an empty text."""
        if grants != self._grants:
            self._grants, self._wishes, self._since_s = grants, wishes, self._clock()
            return ""
        seconds, came = self._clock() - self._since_s, wishes - self._wishes
        if seconds < STALL_S or came < STALL_WISHES:
            return ""
        return f"after {grants} grants nothing was granted for {seconds:.0f} s, while {came} wishes came"


STILL_S: Final = (1.0, 6.0)


class Misfortune:
    """One blow for every so many grants, so that a slow machine does not spend the storm on starting programs."""

    def __init__(self, processes: Sequence[Process], *, every: int, chance: random.Random) -> None:
        self._processes = processes
        self._every = every
        self._chance = chance
        self._next = every
        self._still: dict[str, float] = {}
        """Programs that stand still, and until when."""
        self.kills = self.stops = 0

    def __repr__(self) -> str:
        return f"<Misfortune of {len(self._processes)} programs: {self.kills} kills>"

    def strike(self, grants: int) -> None:
        """Kill or stop one when it is time, wake and start those whose time is over."""
        now_s = time.monotonic()
        for process in self._processes:
            if self._still.get(process.name, now_s) < now_s:
                del self._still[process.name]
                process.resume()
            process.start()  # does nothing to one that runs
        if grants < self._next:
            return
        self._next = grants + self._every
        process = self._chance.choice(self._processes)
        if self._chance.random() < 0.5:
            self._still.pop(process.name, None)
            process.kill()
            self.kills += 1
        elif process.name not in self._still:
            self._still[process.name] = now_s + self._chance.uniform(*STILL_S)
            process.pause()
            self.stops += 1

    def end(self) -> None:
        """Everybody goes on."""
        for process in self._processes:
            process.resume()
            process.start()
        self._still.clear()

    def kill_all(self) -> None:
        """Nobody goes on."""
        for process in self._processes:
            process.kill()
        self._still.clear()

    def lost_answers(self) -> int:
        """Answers that the programs lost, from their logs."""
        return sum(process.log_text().count(LOST) for process in self._processes)


_TICKS_PER_S: Final = os.sysconf("SC_CLK_TCK")
_PRODUCT: Final = ("robotapp_operator", "robotapp_scheduler", "robotapp_agent")
HERE: Final = "the campaign itself"


class Cpu:
    """`sample` now and then: what a program uses after the last look at it is not seen when it is killed."""

    def __init__(self, root: int | None = None) -> None:
        self._root = root or os.getpid()
        self._used: dict[int, tuple[str, float]] = {}
        self._before: Mapping[str, float] = {}

    def __repr__(self) -> str:
        return f"<Cpu of {len(self._used)} processes>"

    def begin(self) -> None:
        """Count from now on."""
        self.sample()
        self._before = self._totals()

    def sample(self) -> None:
        for pid, name, seconds in _descendants(self._root):
            self._used[pid] = (name, seconds)

    def by_program(self) -> dict[str, float]:
        """Seconds since `begin`, the largest first."""
        found = {name: seconds - self._before.get(name, 0.0) for name, seconds in self._totals().items()}
        return dict(sorted(found.items(), key=lambda item: -item[1]))

    def _totals(self) -> dict[str, float]:
        totals: defaultdict[str, float] = defaultdict(float)
        for name, seconds in self._used.values():
            totals[name] += seconds
        return dict(totals)


def _descendants(root: int) -> Iterator[tuple[int, str, float]]:
    children: defaultdict[int, list[int]] = defaultdict(list)
    seconds: dict[int, float] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal():
            with suppress(OSError):
                fields = (entry / "stat").read_text().rpartition(")")[2].split()
                pid = int(entry.name)
                children[int(fields[1])].append(pid)
                seconds[pid] = (int(fields[11]) + int(fields[12])) / _TICKS_PER_S
    left = [root]
    while left:
        pid = left.pop()
        left += children[pid]
        if pid in seconds:
            yield pid, HERE if pid == root else _name_of(pid), seconds[pid]


def _name_of(pid: int) -> str:
    with suppress(OSError):
        words = Path(f"/proc/{pid}/cmdline").read_text(errors="replace").split("\0")
        return next((name for name in _PRODUCT if any(name in word for word in words)), Path(words[0]).name)
    return "ended"


log = logging.getLogger(__name__)

DEVICES_PER_ROBOT: Final = 5
LOOK_S: Final = 0.5
"""How often what happened is judged, and whether a program is to be hurt."""
WAIT_S: Final = 300.0
TELL_S: Final = 20.0
SAMPLE_S: Final = 2.0
"""How often the CPU of all programs is read."""


@dataclass(frozen=True, slots=True)
class Plan:
    """How many wish at a time, for which devices; `every` grants one program is hurt; `lose` is a share of answers.

    `weakened` names a rule that all programs break (claims_weakened); the campaign must notice.
    """

    wanted: int = 500
    robots: int = 10
    every: int = 200
    lose: float = 0.01
    kept: int = 20
    """So many apps, and as many pods, stay when the storm is over; there must be ids for all of them."""
    seed: int = 1
    weakened: str = ""
    full_churn: bool = False
    """A tenth goes each second, even where few hold something."""
    most_s: float = float("inf")
    """The storm ends then, with however few grants."""


@dataclass(slots=True)
class Report:
    verdict: Verdict
    seconds: float
    figures: dict[str, Any]
    stalled: str = ""
    """Nothing was granted any more, in words."""
    gaps: list[str] = field(default_factory=list)
    lost: list[str] = field(default_factory=list)
    left: list[str] = field(default_factory=list)

    @property
    def problems(self) -> list[str]:
        stalled = [self.stalled] if self.stalled else []
        return [*self.verdict.broken[:20], *stalled, *self.gaps, *self.lost, *self.left]


@dataclass(frozen=True, slots=True)
class _Scene:
    """All who take part."""

    site: SimulatedSite
    churn: Churn
    forger: Forger
    recorder: Recorder
    judge: Judge
    misfortune: Misfortune
    cpu: Cpu


class Storm:
    """Many wish for the domains of pool default and for some devices. The plan's seed decides who comes, goes and is hurt."""

    def __init__(self, cp: ControlPlane, plan: Plan) -> None:
        self._cp = cp
        self._plan = plan
        self._random = random.Random(plan.seed)
        self._mark = secrets.token_hex(2)
        names = [f"amr-{self._mark}-{number}" for number in range(plan.robots)]
        cans = [Device(f"can-can{i}", "can", interface=f"can{i}") for i in range(DEVICES_PER_ROBOT)]
        self._nodes = fleet(robots=names, edges=2, clouds=0, devices=dict.fromkeys(names, cans))

    def run(self, grants: int) -> Report:
        """Until so many claims were made, or a rule is broken; then quiet, then nothing.

        Programs that are weakened end with the storm: what they leave behind is no news, and taken away.
        """
        with ExitStack() as stack:
            scene = self._scene(stack)
            began_s = time.monotonic()
            stalled = self._rage(scene, grants)
            seconds = time.monotonic() - began_s
            figures = _figures(scene, seconds)
            lost, left = self._aftermath(scene, stack)
            figures["answers lost"] = scene.misfortune.lost_answers()
        scene.judge.hear(scene.recorder.ripe(all_of_them=True))
        gaps = scene.recorder.problems
        return Report(scene.judge.verdict, seconds, figures, stalled=stalled, gaps=gaps, lost=lost, left=left)

    def _aftermath(self, scene: _Scene, stack: ExitStack) -> tuple[list[str], list[str]]:
        if self._plan.weakened:
            stack.callback(self._clear, scene)
            scene.misfortune.kill_all()
            return [], []
        scene.misfortune.end()
        return self._lost(scene), self._left(scene)

    def _clear(self, scene: _Scene) -> None:
        site = scene.site
        for path in (site.apps_path, path_of(site, "pod"), f"/apis/{API_VERSION}/robotclaims"):
            self._cp.api.delete(path)

    def _scene(self, stack: ExitStack) -> _Scene:
        site = stack.enter_context(self._site())
        stranger = f"stranger-{self._mark}"
        stack.enter_context(created(self._cp, stranger))
        processes = [site.operator, site.another_operator(**self._flags(2)), site.scheduler]
        processes.append(self._second_scheduler(stack))
        recorder = stack.enter_context(Recorder(self._cp))
        churn = Churn(
            site,
            wanted=self._plan.wanted,
            chance=self._chance("churn"),
            holders=recorder.holders,
            full=self._plan.full_churn,
        )
        return _Scene(
            site=site,
            churn=churn,
            forger=Forger(site, stranger, chance=self._chance("forger"), wishes=lambda: churn.there),
            recorder=recorder,
            judge=Judge(namespaces={site.namespace}, strangers={stranger}),
            misfortune=Misfortune(processes, every=self._plan.every, chance=self._chance("misfortune")),
            cpu=Cpu(),
        )

    def _chance(self, whose: str) -> random.Random:
        """Each draws from a source of its own, because they act side by side."""
        return random.Random(f"{whose} {self._plan.seed}")

    def _site(self) -> SimulatedSite:
        return SimulatedSite(
            self._cp, self._nodes, operator_flags=self._flags(1), scheduler_flags=self._flags(3), tidy=False
        )

    def _second_scheduler(self, stack: ExitStack) -> Process:
        """A Lease of its own lets it work at the same time as the first."""
        space = stack.enter_context(created(self._cp, f"second-{self._mark}"))
        user = f"--user=system:serviceaccount:{SYSTEM_NAMESPACE}:{SCHEDULER_MANAGER}"
        self._cp.kubectl("-n", space, "create", "role", "leases", "--verb=*", "--resource=leases.coordination.k8s.io")
        self._cp.kubectl("-n", space, "create", "rolebinding", "own-lease", "--role=leases", user)
        flags: dict[str, Any] = {"sweep_seconds": 1, "lease_namespace": space, **self._flags(4)}
        second = product.start_scheduler(self._cp, name="scheduler-2", **flags)
        stack.callback(second.kill)
        return second

    def _flags(self, number: int) -> dict[str, Any]:
        seed = self._plan.seed * 10 + number
        return {
            "program": program.command(lose=self._plan.lose, seed=seed, weakened=self._plan.weakened),
            "env": {"PYTHONPATH": os.pathsep.join([str(REPOSITORY), *filter(None, [os.environ.get("PYTHONPATH")])])},
        }

    def _rage(self, scene: _Scene, grants: int) -> str:
        """Until it is enough, or nothing is granted any more: then that is told."""
        recorder, broken = scene.recorder, scene.judge.verdict.broken
        end_s = time.monotonic() + self._plan.most_s
        sample_s, tell_s = time.monotonic() + SAMPLE_S, time.monotonic() + TELL_S
        stall, stalled = Stall(time.monotonic), ""
        scene.cpu.begin()
        with scene.churn, scene.forger:
            while recorder.claims < grants and not (recorder.problems or broken or stalled):
                if time.monotonic() > end_s:
                    break
                scene.misfortune.strike(recorder.claims)
                scene.judge.hear(recorder.ripe())
                scene.churn.check()
                scene.forger.check()
                stalled = stall.look(grants=recorder.claims, wishes=scene.churn.made)
                if time.monotonic() > sample_s:
                    sample_s += SAMPLE_S
                    scene.cpu.sample()
                if time.monotonic() > tell_s:
                    tell_s += TELL_S
                    log.info("%d grants, %r, %r", recorder.claims, scene.churn, scene.misfortune)
                time.sleep(LOOK_S)
        return stalled

    def _lost(self, scene: _Scene) -> list[str]:
        """With fewer wishes than there is, everybody who stays must be served."""
        there = [[what for what in scene.churn.there if what[0] == kind] for kind in ("app", "pod")]
        kept = [what for some in there for what in some[: self._plan.kept]]
        scene.churn.keep(kept)

        def waiting() -> list[str]:
            return [text for kind in ("app", "pod") for text in self._waiting(scene.site, kind, kept)]

        wait_until(lambda: not waiting(), timeout_s=WAIT_S, poll_s=0.5)
        return waiting()

    def _waiting(self, site: SimulatedSite, kind: str, kept: Collection[Wish]) -> list[str]:
        """Those of a kind who are not served, and what the product says about it."""
        names = {name for each, name in kept if each == kind}
        found = {each["metadata"]["name"]: each for each in self._cp.api.get(path_of(site, kind))["items"]}
        served = _bound if is_pod(kind) else _served
        return [
            f"{kind} {name} was never served: {found.get(name, {}).get('status')}"
            for name in sorted(names)
            if not served(found.get(name))
        ]

    def _left(self, scene: _Scene) -> list[str]:
        site = scene.site
        scene.forger.clear()
        self._cp.api.delete(site.apps_path)
        self._cp.api.delete(f"/api/v1/namespaces/{site.namespace}/pods")

        def left() -> list[str]:
            return [claim["metadata"]["name"] for claim in site.claims()]

        wait_until(lambda: not left(), timeout_s=WAIT_S, poll_s=0.5)
        return [f"claim {name} is left" for name in left()]


def _figures(scene: _Scene, seconds: float) -> dict[str, Any]:
    recorder, churn, misfortune = scene.recorder, scene.churn, scene.misfortune
    scene.cpu.sample()
    used, grants = scene.cpu.by_program(), max(1, recorder.claims)
    return {
        "grants/s": round(recorder.claims / seconds, 2),
        "CPU s per grant": round(sum(used.values()) / grants, 4),
        "of which": {name: round(cpu_s / grants, 4) for name, cpu_s in used.items() if cpu_s / grants > 0.0005},
        "revisions": recorder.revisions,
        "wishes": churn.made,
        "churn/s": round(churn.per_second, 4),
        "churn limited by": churn.limit,
        "requests without answer": churn.unanswered,
        "kills": misfortune.kills,
        "stops": misfortune.stops,
        "forged": scene.forger.forged,
        "forgeries refused": scene.forger.refused,
    }


def _served(app: Object | None) -> bool:
    conditions = {each["type"]: each for each in (app or {}).get("status", {}).get("conditions", ())}
    return bool(conditions.get("Ready", {}).get("status") == "True")


def _bound(pod: Object | None) -> bool:
    return bool(pod and pod["spec"].get("nodeName"))
