"""All folders share one control plane, so every module leaves it as it was before."""

from collections.abc import Iterator

import pytest

from campaigns.rigs.leftovers import leaving_nothing_behind
from robotapp_testbed.pytest_plugin import running_plane


@pytest.fixture(scope="module", autouse=True)
def _leaves_nothing_behind() -> Iterator[None]:
    with leaving_nothing_behind(running_plane):
        yield
