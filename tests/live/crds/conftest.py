"""The definitions are installed once for all tests of this folder: none of them changes one."""

import pytest
from tests.support import crds

from robotapp_testbed import ControlPlane


@pytest.fixture(scope="session", autouse=True)
def _installed(control_plane: ControlPlane) -> None:
    crds.install(control_plane)
