"""All folders share one control plane, so every module leaves it as it found it."""

from collections.abc import Iterator

import pytest
from tests.support.leftovers import leftovers, settled

from robotapp_testbed.pytest_plugin import running_plane


@pytest.fixture(scope="module", autouse=True)
def _leaves_nothing_behind() -> Iterator[None]:
    plane = running_plane()
    before = leftovers(plane) if plane else set()
    yield
    plane = running_plane()
    left = settled(plane, before) if plane else set()
    assert not left, f"other modules would meet what this one leaves: {sorted(left)}"
