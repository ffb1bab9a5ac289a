"""The acceptance of "exactly as kube-scheduler": the same pods through both, live, one at a time."""

import asyncio
import json

import pytest
from tests.bench import parity_preemption
from tests.bench.parity import run

from robotapp_testbed import ControlPlane
from robotapp_testbed.product import install

CASES = 300


@pytest.mark.live
@pytest.mark.slow
def test_60_full_clusters_lose_the_same_victims_with_the_same_words_as_to_kube_scheduler() -> None:
    with ControlPlane(kwok=False, controller_manager=False) as cp:
        install(cp)
        report = asyncio.run(parity_preemption.run(cp, cases=60, seed=1, say=lambda _: None))
    assert report["preempted"] > 20
    assert report["refused"] > 5
    assert not report["differences"], json.dumps(report["differences"][:3], indent=2)


@pytest.mark.live
@pytest.mark.slow
def test_300_pods_of_mixed_shapes_get_the_same_nodes_scores_and_texts_as_from_kube_scheduler() -> None:
    with ControlPlane(kwok=False, controller_manager=False) as cp:
        install(cp)
        report = asyncio.run(run(cp, cases=CASES, seed=1, say=lambda _: None))
    assert report["cases"] == CASES
    assert report["bound"] > CASES // 5
    assert report["refused"] > CASES // 5
    assert not report["differences"], json.dumps(report["differences"][:3], indent=2)
