"""One process falls asleep at any request of its work; the others go on without it; then it wakes up.

Every process, every request, in every situation in which ids change hands. One id, two apps that want it.
"""

import asyncio
import itertools
import random
from collections.abc import Iterable
from dataclasses import dataclass

from campaigns.claims.claim_cluster import ClaimCluster, Director

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
    cluster = ClaimCluster(ids="1", chance=random.Random(f"{case}{case.luck}"))
    director = Director(cluster)
    cluster.create_app("a")
    for name in "ab":
        director.add(f"operator 1 {name}", lambda client, app=name: cluster.operate(client, app))
        director.add(f"operator 2 {name}", lambda client, app=name: cluster.operate(client, app))
    for number in "12":
        director.add(f"manager {number}", cluster.control)
        director.add(f"scheduler {number}", cluster.schedule)
        director.add(f"sweeper {number}", cluster.sweeping())
    return director


async def prepare(director: Director, situation: str) -> None:
    cluster = director.cluster
    if situation != "new":
        await director.rest(time_passes=False)
    if situation in {"given up", "rested"}:
        cluster.toggle_ros("a")
        await director.rest(time_passes=False)
    if situation == "rested":
        cluster.now += 6
    if situation == "deleted":
        cluster.delete_app("a")
        await director.rest(time_passes=False)
    cluster.create_app("b")


def happen(director: Director, event: str) -> None:
    director.steps.append(f"--- {event}")
    cluster = director.cluster
    if event in {"delete", "replace"}:
        cluster.delete_app("a")
    if event == "replace":
        cluster.create_app("a")
    if event == "toggle":
        cluster.toggle_ros("a")


async def play(case: Case) -> None:
    director = cast(case)
    names = [actor.name for actor in director.cluster.actors]
    sleeper = names.index(case.sleeper)
    try:
        await prepare(director, case.situation)
        for _ in range(case.requests + 1):
            await director.step(sleeper, "go")
        happen(director, case.event)
        if case.event == "toggle twice":
            director.cluster.toggle_ros("a")
            await director.rest(without=sleeper, time_passes=False)
            director.cluster.toggle_ros("a")
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
