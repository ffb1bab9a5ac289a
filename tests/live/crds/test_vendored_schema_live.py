"""The borrowed core schema is that of the server the testbed runs."""

import pytest

from robotapp_api.schema import vendor
from robotapp_testbed import ControlPlane

pytestmark = pytest.mark.live


def test_the_vendored_schema_is_what_the_pinned_server_publishes(control_plane: ControlPlane) -> None:
    version = control_plane.api.get("/version")["gitVersion"]
    document = vendor.extract(control_plane.api.get("/openapi/v3/api/v1"), version)
    assert vendor.FILE.read_text() == vendor.render(document)
