from collections.abc import AsyncIterator

import pytest

from campaigns.rigs.claims_live import Live, live
from robotapp_testbed import ControlPlane


@pytest.fixture
async def place(installed_plane: ControlPlane, namespace: str) -> AsyncIterator[Live]:
    """A namespace and a pool of five ids with a rest of one second; our own rights, not the administrator's."""
    async with live(installed_plane, namespace) as found:
        await found.make_pool()
        yield found
