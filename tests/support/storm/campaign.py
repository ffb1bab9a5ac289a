"""Apps and pods come and go by the second while programs are killed, answers get lost and strangers forge what they may."""

import logging
import random
import secrets
import time
from collections.abc import Callable, Collection, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from typing import Any, Final

from tests.support.storm import program
from tests.support.storm.history import Judge, Verdict
from tests.support.storm.misfortune import Misfortune
from tests.support.storm.recorder import Recorder
from tests.support.storm.wishes import KINDS, forgery, is_pod, wish
from tests.support.world import Object, World

from robotapp_api.model.names import API_VERSION, SCHEDULER_MANAGER, SYSTEM_NAMESPACE
from robotapp_testbed import ControlPlane, Process, product, wait_until
from robotapp_testbed.failures import ApiStatusError
from robotapp_testbed.namespaces import created
from robotapp_testbed.pins import REPOSITORY
from robotapp_testbed.topology import Device, fleet

log = logging.getLogger(__name__)

DEVICES_PER_ROBOT: Final = 5
CHURN: Final = 0.1
"""Of what is wanted, this much goes each second, and as much comes."""
SERVED: Final = 0.8
"""So much of what goes holds a domain or a device: by chance alone it would be a fifth, and the rest would wait in vain."""
ROUND_S: Final = 1.0
PEOPLE: Final = 8
"""Requests at once."""
WAIT_S: Final = 300.0
TELL_ROUNDS: Final = 20
STRANGE: Final = {"deployments": "/apis/apps/v1", "pods": "/api/v1"}


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
    most_s: float = float("inf")
    """The storm ends then, with however few grants."""


@dataclass(slots=True)
class Report:
    verdict: Verdict
    seconds: float
    figures: dict[str, float]
    gaps: list[str] = field(default_factory=list)
    lost: list[str] = field(default_factory=list)
    left: list[str] = field(default_factory=list)

    @property
    def problems(self) -> list[str]:
        return [*self.verdict.broken[:20], *self.gaps, *self.lost, *self.left]


@dataclass(frozen=True, slots=True)
class _Scene:
    """Who takes part."""

    world: World
    stranger: str
    """A namespace in which all is forged."""
    people: ThreadPoolExecutor
    recorder: Recorder
    judge: Judge
    misfortune: Misfortune

    def all(self, action: Callable[[tuple[str, str]], None], items: Iterable[tuple[str, str]]) -> None:
        """Do it for all, several at once; the first error is raised."""
        list(self.people.map(action, items))


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
        self._there: list[tuple[str, str]] = []
        """(kind, name) of what was made and not deleted."""
        self._number = self._gone = self._rounds = self._forged = self._refused = 0

    def run(self, grants: int) -> Report:
        """Until so many claims were made, or a rule is broken; then quiet, then nothing.

        Programs that are weakened end with the storm: what they leave behind is no news, and taken away.
        """
        with ExitStack() as stack:
            scene = self._scene(stack)
            began_s = time.monotonic()
            self._rage(scene, grants)
            seconds = time.monotonic() - began_s
            lost, left = self._aftermath(scene, stack)
            figures = self._figures(scene, seconds)
        scene.judge.hear(scene.recorder.ripe(all_of_them=True))
        return Report(scene.judge.verdict, seconds, figures, gaps=scene.recorder.problems, lost=lost, left=left)

    def _aftermath(self, scene: _Scene, stack: ExitStack) -> tuple[list[str], list[str]]:
        if self._plan.weakened:
            stack.callback(self._clear, scene)
            scene.misfortune.kill_all()
            return [], []
        scene.misfortune.end()
        return self._lost(scene), self._left(scene)

    def _clear(self, scene: _Scene) -> None:
        world = scene.world
        for path in (world.apps_path, _path(world, "pod"), f"/apis/{API_VERSION}/robotclaims"):
            self._cp.api.delete(path)

    def _scene(self, stack: ExitStack) -> _Scene:
        people = stack.enter_context(ThreadPoolExecutor(PEOPLE))
        world = stack.enter_context(self._world())
        stranger = f"stranger-{self._mark}"
        stack.enter_context(created(self._cp, stranger))
        processes = [world.operator, world.another_operator(**self._flags(2)), world.scheduler]
        processes.append(self._second_scheduler(stack))
        recorder = stack.enter_context(Recorder(self._cp))
        misfortune = Misfortune(processes, every=self._plan.every, chance=self._random)
        judge = Judge(namespaces={world.namespace}, strangers={stranger})
        return _Scene(world, stranger, people, recorder, judge, misfortune)

    def _world(self) -> World:
        return World(self._cp, self._nodes, operator_flags=self._flags(1), scheduler_flags=self._flags(3), tidy=False)

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
            "env": {"PYTHONPATH": str(REPOSITORY)},
        }

    def _rage(self, scene: _Scene, grants: int) -> None:
        recorder, broken = scene.recorder, scene.judge.verdict.broken
        end_s = time.monotonic() + self._plan.most_s
        while recorder.claims < grants and not (recorder.problems or broken) and time.monotonic() < end_s:
            round_s = time.monotonic()
            self._churn(scene)
            self._forge(scene)
            scene.misfortune.strike(recorder.claims)
            scene.judge.hear(recorder.ripe())
            self._rounds += 1
            if self._rounds % TELL_ROUNDS == 0:
                log.info("%d grants, %d wishes, %r", recorder.claims, self._number, scene.misfortune)
            time.sleep(max(0.0, ROUND_S - (time.monotonic() - round_s)))

    def _churn(self, scene: _Scene) -> None:
        going = self._going(scene.recorder.holders())
        coming = [self._wish() for _ in range(self._plan.wanted - len(self._there))]
        scene.all(lambda what: self._delete(scene.world, what), going)
        scene.all(lambda what: self._create(scene.world, what), coming)
        self._there += coming
        self._gone += len(going)

    def _going(self, holders: Collection[str]) -> list[tuple[str, str]]:
        """Takes them off the list: some of those who hold something, the rest by chance, out of the line as well."""
        self._random.shuffle(self._there)
        count = min(int(self._plan.wanted * CHURN), len(self._there))
        served = [what for what in self._there if what[1] in holders][: int(count * SERVED)]
        others = [what for what in self._there if what not in served][: count - len(served)]
        going = [*served, *others]
        self._there = [what for what in self._there if what not in going]
        return going

    def _wish(self) -> tuple[str, str]:
        self._number += 1
        return self._random.choice(KINDS), f"s-{self._number}"

    def _create(self, world: World, what: tuple[str, str]) -> None:
        self._cp.api.create(_path(world, what[0]), wish(*what))

    def _delete(self, world: World, what: tuple[str, str]) -> None:
        with _refusals(404, 409):
            self._cp.api.delete(f"{_path(world, what[0])}/{what[1]}")

    def _forge(self, scene: _Scene) -> None:
        """Two things of another tenant that name an app of ours; all of them are taken away now and then."""
        apps = [name for kind, name in self._there if not is_pod(kind)]
        for name in self._random.sample(apps, min(2, len(apps))):
            with _refusals(404, 409):
                kind, forged = forgery(self._random, app=scene.world.app(name))
                self._forged += 1
                with _refusals(403, 422, note=self._note_refused):
                    self._cp.api.create(f"{STRANGE[kind]}/namespaces/{scene.stranger}/{kind}", forged)
        if self._rounds % 20 == 19:
            self._take_away(scene.stranger)

    def _note_refused(self) -> None:
        self._refused += 1

    def _take_away(self, stranger: str) -> None:
        for kind, api in STRANGE.items():
            self._cp.api.delete(f"{api}/namespaces/{stranger}/{kind}")

    def _lost(self, scene: _Scene) -> list[str]:
        """With fewer wishes than there is, everybody who stays must be served."""
        there = [[what for what in self._there if what[0] == kind] for kind in ("app", "pod")]
        kept = [what for some in there for what in some[: self._plan.kept]]
        scene.all(lambda what: self._delete(scene.world, what), [each for each in self._there if each not in kept])

        def waiting() -> list[str]:
            return [text for kind in ("app", "pod") for text in self._waiting(scene.world, kind, kept)]

        wait_until(lambda: not waiting(), timeout_s=WAIT_S, poll_s=0.5)
        return waiting()

    def _waiting(self, world: World, kind: str, kept: Collection[tuple[str, str]]) -> list[str]:
        """Those of a kind who are not served, and what the product says about it."""
        names = {name for each, name in kept if each == kind}
        found = {each["metadata"]["name"]: each for each in self._cp.api.get(_path(world, kind))["items"]}
        served = _bound if is_pod(kind) else _served
        return [
            f"{kind} {name} was never served: {found.get(name, {}).get('status')}"
            for name in sorted(names)
            if not served(found.get(name))
        ]

    def _left(self, scene: _Scene) -> list[str]:
        world = scene.world
        self._take_away(scene.stranger)
        self._cp.api.delete(world.apps_path)
        self._cp.api.delete(f"/api/v1/namespaces/{world.namespace}/pods")

        def left() -> list[str]:
            return [claim["metadata"]["name"] for claim in world.claims()]

        wait_until(lambda: not left(), timeout_s=WAIT_S, poll_s=0.5)
        return [f"claim {name} is left" for name in left()]

    def _figures(self, scene: _Scene, seconds: float) -> dict[str, float]:
        recorder, misfortune = scene.recorder, scene.misfortune
        return {
            "grants/s": round(recorder.claims / seconds, 2),
            "revisions": recorder.revisions,
            "churn/s": round(self._gone / seconds / self._plan.wanted, 3),
            "kills": misfortune.kills,
            "stops": misfortune.stops,
            "answers lost": misfortune.lost_answers(),
            "forged": self._forged,
            "forgeries refused": self._refused,
        }


def _path(world: World, kind: str) -> str:
    return f"/api/v1/namespaces/{world.namespace}/pods" if is_pod(kind) else world.apps_path


def _served(app: Object | None) -> bool:
    conditions = {each["type"]: each for each in (app or {}).get("status", {}).get("conditions", ())}
    return bool(conditions.get("Ready", {}).get("status") == "True")


def _bound(pod: Object | None) -> bool:
    return bool(pod and pod["spec"].get("nodeName"))


@contextmanager
def _refusals(*allowed: int, note: Callable[[], None] = lambda: None) -> Iterator[None]:
    """These answers of the server are none of our business."""
    try:
        yield
    except ApiStatusError as error:
        if error.status not in allowed:
            raise
        note()
