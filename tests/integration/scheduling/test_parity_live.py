"""The acceptance of "exactly as kube-scheduler": cases of all feature families through both, live, with a new seed each time."""

import asyncio
import json
import random

import pytest
from tests.bench import parity_live

CASES = 6 * len(parity_live.LIVE)


@pytest.mark.live
@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_cases_of_every_family_get_the_same_nodes_scores_texts_and_victims_as_from_kube_scheduler() -> None:
    """`scripts/bench parity --seed S --case N` shows the one that fails."""
    seed = str(random.randrange(10**6))
    with parity_live.control_plane() as cp:
        cases = parity_live.campaign(seed, CASES)
        report = asyncio.run(parity_live.run(cp, cases, seed=seed, say=lambda _: None))
    assert not report.found, f"--seed {seed}: {json.dumps(report.found[:3], indent=2)}"
    assert report.compared["bound"] > CASES // 4
    assert report.compared["refused"] > CASES // 4
    assert report.compared["preempted"] > 0
    assert not report.invalid
