"""The protocol's own coroutines, interleaved request by request, with deaths, lost answers and zombies."""

import asyncio
import contextlib
import random
from collections import Counter
from collections.abc import Iterator
from unittest import mock

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support.claims_world import Director, World

from robotapp_api.claims import release
from robotapp_api.claims.bind import ALLOWED
from robotapp_api.claims.objects import Claim, Pod
from robotapp_api.claims.release import Preconditions, Release

APPS = ("a", "b", "c")


async def run(seed: int, *, length: int = 500, ids: str = "1-2") -> list[str]:
    """One interleaving of `length` requests, then peace. Raises AssertionError with all steps on a violation."""
    chance = random.Random(seed)
    world = World(ids=ids)
    director = Director(world)
    for name in APPS[:2]:
        world.create_app(name)
    for name in APPS:  # two operators, so one of them may sleep through anything
        director.add(f"operator 1 {name}", lambda client, app=name: world.operate(client, app))
        director.add(f"operator 2 {name}", lambda client, app=name: world.operate(client, app))
    for number in "12":
        director.add(f"manager {number}", world.control)
        director.add(f"scheduler {number}", world.schedule)
        director.add(f"sweeper {number}", world.sweeping())
    asleep: set[int] = set()
    try:
        for _ in range(length):
            if chance.random() < 0.02:
                asleep ^= {chance.randrange(len(world.actors))}
            if chance.random() < 0.02:
                app = chance.choice(APPS)
                director.steps.append(f"delete {app}")
                world.delete_app(app)
                if chance.random() < 0.6:
                    director.steps.append(f"create {app}")
                    world.create_app(app)
            world.now += chance.choice((0, 0, 0, 1, 6))
            choice = chance.choice([index for index in range(len(world.actors)) if index not in asleep])
            fate = chance.choices(("go", "die", "lose"), (90, 3, 7))[0]
            await director.step(choice, fate)
        await director.finish()
    finally:
        await director.close()
    return director.steps


@settings(max_examples=40, deadline=None, derandomize=False)
@given(st.integers(0, 2**32))
def test_no_interleaving_shares_an_id_or_loses_a_claim_and_all_come_to_rest(seed: int) -> None:
    asyncio.run(run(seed))


def test_the_interleavings_reach_every_write_of_the_protocol_and_every_fault() -> None:
    seen: Counter[str] = Counter()
    for seed in range(12):
        for step in asyncio.run(run(seed)):
            actor, _, rest = step.partition(": ")
            words = rest.split()
            if words:
                seen[f"{actor.split()[0]} {words[0]} {words[1]} {words[-1]}"] += 1
    for needed in (
        "operator create robotclaims (go)",
        "operator create robotclaims (lose)",
        "operator create robotclaims (die)",
        "operator replace robotclaims (go)",
        "operator replace deployments (go)",
        "scheduler replace pods (go)",
        "scheduler replace pods (lose)",
        "sweeper replace robotclaims (go)",
        "sweeper delete robotclaims (go)",
        "sweeper delete robotclaims (lose)",
    ):
        assert seen[needed], f"no run had {needed!r}: {seen}"


@contextlib.contextmanager
def no_bind_check() -> Iterator[None]:
    def always(_: Pod, __: Claim | None, **___: object) -> object:
        return ALLOWED

    with mock.patch("robotapp_api.client.claims.bind_verdict", always):
        yield


@contextlib.contextmanager
def uid_only() -> Iterator[None]:
    def weak(claim: Claim) -> Preconditions:
        return Preconditions(claim.metadata.uid, "")

    with mock.patch("robotapp_api.client.claim_writes.preconditions", weak):
        yield


@contextlib.contextmanager
def one_phase() -> Iterator[None]:
    def hasty(**facts: bool) -> Release:
        decision = release.release_domain(**facts)
        return Release.DELETE if decision is Release.DRAIN else decision

    with mock.patch("robotapp_api.client.sweep.release_domain", hasty):
        yield


@pytest.mark.parametrize("weakened", [no_bind_check, uid_only, one_phase])
def test_interleavings_catch_a_weakened_rule(weakened: object) -> None:
    caught = 0
    with weakened():  # type: ignore[operator]  # one of the context managers above
        for seed in range(60):
            try:
                asyncio.run(run(seed))
            except AssertionError:
                caught += 1
                break
    assert caught
