"""Every sentence on the screen is so: a rotating sample of situations here, all of them by `scripts/bench truth`."""

import random
import secrets
from collections.abc import Iterator

import pytest
from tests.support.seeds import daily_seed

from campaigns.rigs.simulated_site import SimulatedSite
from campaigns.truth.arranging import Place, nodes, pools
from campaigns.truth.over_time import LONG
from campaigns.truth.situations import SITUATIONS
from campaigns.truth.truth import run
from robotapp_testbed import ControlPlane

pytestmark = pytest.mark.live
SAMPLE = 12


@pytest.fixture(scope="module")
def place(installed_plane: ControlPlane) -> Iterator[Place]:
    mark = secrets.token_hex(2)
    with SimulatedSite(installed_plane, nodes(mark), pools=pools(mark)) as world:
        yield Place(world, mark)


def test_there_are_enough_situations() -> None:
    assert len(SITUATIONS) >= 65
    assert SITUATIONS.keys() > LONG


@pytest.mark.parametrize("name", random.Random(daily_seed()).sample(sorted(SITUATIONS.keys() - LONG), SAMPLE))
def test_what_is_told_is_so(place: Place, name: str) -> None:
    assert run(place, SITUATIONS[name]) == [], f"repeat with ROBOTAPP_SEED={daily_seed()}"
