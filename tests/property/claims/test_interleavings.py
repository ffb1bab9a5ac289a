"""The protocol's own coroutines, interleaved request by request, with deaths, lost answers and zombies."""

import asyncio
import random
from collections import Counter

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support.seeds import count_examples

from campaigns.claims.claim_cluster import ClaimCluster, Director
from campaigns.claims.claims_weakened import one_phase

APPS = ("a", "b", "c")


def people(director: Director, chance: random.Random) -> None:
    app, what = chance.choice(APPS), chance.choice(("delete", "replace", "toggle", "toggle"))
    director.steps.append(f"{what} {app}")
    if what == "toggle":
        director.cluster.toggle_ros(app)
        return
    director.cluster.delete_app(app)
    if what == "replace":
        director.cluster.create_app(app)


async def run(seed: int, *, length: int = 1200, ours: bool = True) -> list[str]:
    """One interleaving of `length` requests, then peace. Raises AssertionError with all steps on a violation.

    ours: whether one of the two schedulers is. Its writes into claims refuse hasty sweepers that others do not.
    """
    chance = random.Random(seed)
    cluster = ClaimCluster(ids=chance.choice(("1", "1", "1-2")), chance=chance)
    director = Director(cluster)
    for name in APPS[:2]:
        cluster.create_app(name)
    for name in APPS:  # two operators, so one of them may sleep through anything
        director.add(f"operator 1 {name}", lambda client, app=name: cluster.operate(client, app))
        director.add(f"operator 2 {name}", lambda client, app=name: cluster.operate(client, app))
    for number in "12":
        director.add(f"manager {number}", cluster.control)
        director.add(f"scheduler {number}", cluster.schedule if ours and number == "1" else cluster.schedule_elsewhere)
        director.add(f"sweeper {number}", cluster.sweeping())
    actor, left = 0, 0
    try:
        for _ in range(length):
            if not left:  # whoever was at work is put to sleep wherever it is, perhaps for long
                kind = chance.choice(("operator", "manager", "scheduler", "sweeper"))
                actor = chance.choice([n for n, one in enumerate(cluster.actors) if one.name.startswith(kind)])
                left = chance.choice((1, 2, 3, 4, 5, 6, 7, 20))
                cluster.now += chance.choice((0, 0, 6))
                if chance.random() < 0.15:
                    people(director, chance)
            left -= 1
            await director.step(actor, chance.choices(("go", "die", "lose"), (95, 1, 4))[0])
        await director.finish()
    finally:
        await director.close()
    return director.steps


@settings(max_examples=count_examples(40), deadline=None, derandomize=False)
@given(st.integers(0, 2**32))
def test_no_interleaving_shares_an_id_or_loses_a_claim_and_all_come_to_rest(seed: int) -> None:
    asyncio.run(run(seed))


def test_the_interleavings_find_a_release_in_one_phase() -> None:
    async def runs() -> None:
        for seed in range(600):  # about every 150th finds it
            await run(seed)

    with one_phase(), pytest.raises(AssertionError, match="without its claim"):
        asyncio.run(runs())


def test_the_interleavings_reach_every_write_of_the_protocol_and_every_fault() -> None:
    seen: Counter[str] = Counter()
    for seed in range(40):
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
        "scheduler create pods/binding (go)",
        "scheduler create pods/binding (lose)",
        "sweeper replace robotclaims (go)",
        "sweeper delete robotclaims (go)",
        "sweeper delete robotclaims (lose)",
    ):
        assert seen[needed], f"no run had {needed!r}: {seen}"
