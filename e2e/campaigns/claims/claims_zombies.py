"""One process falls asleep at any request of its work; the world goes on without it; then it wakes up.

Every process, every request, in every situation in which ids change hands. One id, two apps that want it.
"""

import asyncio
import itertools
import random
from collections.abc import Iterable
from dataclasses import dataclass

from campaigns.claims.claims_world import Director, World

SITUATIONS = ("new", "running", "given up", "rested", "deleted")
EVENTS = ("nothing", "toggle", "delete", "replace", "toggle twice")
SLEEPERS = {"sweeper 1": 8, "operator 1 a": 7, "scheduler 1": 4, "manager 1": 2}
"""With the most requests one round of their work has."""


@dataclass(frozen=True)
class Case:
    sleeper: str
    situation: str
    event: str
    requests: int
    luck: int = 0
    """Seed of what the controllers do first."""

    def __str__(self) -> str:
        return f"{self.sleeper} sleeps after {self.requests} requests, {self.situation}, then {self.event}"


CASES = [
    Case(sleeper, situation, event, requests)
    for (sleeper, most), situation, event in itertools.product(SLEEPERS.items(), SITUATIONS, EVENTS)
    for requests in range(1, most + 1)
]


def cast(case: Case) -> Director:
    world = World(ids="1", chance=random.Random(f"{case}{case.luck}"))
    director = Director(world)
    world.create_app("a")
    for name in "ab":
        director.add(f"operator 1 {name}", lambda client, app=name: world.operate(client, app))
        director.add(f"operator 2 {name}", lambda client, app=name: world.operate(client, app))
    for number in "12":
        director.add(f"manager {number}", world.control)
        director.add(f"scheduler {number}", world.schedule)
        director.add(f"sweeper {number}", world.sweeping())
    return director


async def prepare(director: Director, situation: str) -> None:
    world = director.world
    if situation != "new":
        await director.rest(time_passes=False)
    if situation in {"given up", "rested"}:
        world.toggle_ros("a")
        await director.rest(time_passes=False)
    if situation == "rested":
        world.now += 6
    if situation == "deleted":
        world.delete_app("a")
        await director.rest(time_passes=False)
    world.create_app("b")


def happen(director: Director, event: str) -> None:
    director.steps.append(f"--- {event}")
    world = director.world
    if event in {"delete", "replace"}:
        world.delete_app("a")
    if event == "replace":
        world.create_app("a")
    if event == "toggle":
        world.toggle_ros("a")


async def play(case: Case) -> None:
    director = cast(case)
    names = [actor.name for actor in director.world.actors]
    sleeper = names.index(case.sleeper)
    try:
        await prepare(director, case.situation)
        for _ in range(case.requests + 1):
            await director.step(sleeper, "go")
        happen(director, case.event)
        if case.event == "toggle twice":
            director.world.toggle_ros("a")
            await director.rest(without=sleeper, time_passes=False)
            director.world.toggle_ros("a")
        await director.rest(without=sleeper, time_passes=case.event != "toggle")
        director.steps.append("--- it wakes")
        await director.round(sleeper)
        await director.rest()
        await director.finish()
    finally:
        await director.close()


def first_failure(cases: Iterable[Case]) -> str:
    """Which case breaks the protocol, and how; empty when none does."""
    for case in cases:
        try:
            asyncio.run(play(case))
        except AssertionError as violation:
            return f"{case}\n{violation}"
    return ""
