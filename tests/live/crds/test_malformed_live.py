"""Every wrong value of a RobotApp is refused by the API server with the field and what is allowed."""

import pytest
from tests.support import crds
from tests.support.wrong_input.malformed import full_app, malformed_apps

from robotapp_api.model.app.robotapp import RobotApp
from robotapp_api.schema.crd import schema_of
from robotapp_testbed import ControlPlane
from robotapp_testbed.failures import ApiStatusError

pytestmark = pytest.mark.live

PATH = crds.collection("RobotApp") + "?dryRun=All&fieldValidation=Strict"


def test_an_app_with_every_field_is_accepted(control_plane: ControlPlane) -> None:
    control_plane.api.create(PATH, full_app())


def test_each_wrong_value_is_refused_with_its_field(control_plane: ControlPlane) -> None:
    unclear = []
    for case in malformed_apps(schema_of(RobotApp)):
        with pytest.raises(ApiStatusError) as refused:
            control_plane.api.create(PATH, case.obj)
        if refused.value.status not in (400, 422) or case.field not in refused.value.message:
            unclear.append((case.field, refused.value.message))
    assert unclear == []
