"""The scheduler while its control plane is hurt: another sample of `scripts/bench faults` every day."""

import asyncio
import random
from typing import Any

import pytest
from tests.support.seeds import daily_seed

from campaigns.faults.campaign import Campaign
from campaigns.faults.faults import ROOM, plan
from robotapp_testbed import ControlPlane

PODS = 250
SAMPLED = ("api-restart", "etcd-restart", "watches", "storm", "two-schedulers")
"""Quick ones that need nothing installed; the zombie alone takes a minute, the clocks need libfaketime."""
ELECTION = {"leaseDuration": "9s", "renewDeadline": "8s", "retryPeriod": "500ms"}


async def sample(cp: ControlPlane) -> list[dict[str, Any]]:
    chance = random.Random(daily_seed())
    found = []
    async with Campaign(cp) as campaign:
        for name in chance.sample(SAMPLED, 2):
            room = ROOM[chance.choice(sorted(ROOM))]
            found.append(await campaign.run(plan(cp, name, pods=PODS, seed=daily_seed(), room=room, election=ELECTION)))
    return found


@pytest.mark.live
@pytest.mark.timeout(1200)
def test_whatever_is_killed_or_lies_every_pod_is_bound_once_or_told_why_and_no_node_is_overfull() -> None:
    with ControlPlane(kwok=False, controller_manager=False, audit=True) as cp:
        found = asyncio.run(sample(cp))
    problems = {each["fault"]: each["problems"] for each in found if each["problems"]}
    assert problems == {}, f"repeat with ROBOTAPP_SEED={daily_seed()}: {found}"
