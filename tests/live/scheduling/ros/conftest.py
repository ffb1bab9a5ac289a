"""What live tests of ROS rules share."""

from collections.abc import Iterator

import pytest

from robotapp_api.model.names import API_VERSION
from robotapp_testbed import ControlPlane

POOL = f"/apis/{API_VERSION}/domainpools/default"


@pytest.fixture
def short_rest(installed_plane: ControlPlane) -> Iterator[None]:
    """Ids rest for one second instead of the shipped sixty."""
    before = installed_plane.api.get(POOL)["spec"].get("quarantineSeconds")
    installed_plane.api.patch(POOL, {"spec": {"quarantineSeconds": 1}})
    yield
    installed_plane.api.patch(POOL, {"spec": {"quarantineSeconds": before}})
