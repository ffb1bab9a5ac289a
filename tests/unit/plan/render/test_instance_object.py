"""Name, owner and identity of a RobotAppInstance."""

from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.factories import make_app

from robotapp_api.values.naming import child_name
from robotapp_operator.plan.render.instance_object import AppInstance, is_as_wanted, object_name, wanted_object
from robotapp_operator.plan.spec.desired import MASTER, PEERS, ROUTER, SERVERS

NAMES = st.from_regex(r"[a-z0-9]([-a-z0-9]{0,8}[a-z0-9])?", fullmatch=True)
APP = make_app()


def stored(**meta: Any) -> AppInstance:
    body = wanted_object(APP, "amr-07")
    body["metadata"] |= {"uid": "u", "resourceVersion": "12", **meta}
    return msgspec.convert(body, AppInstance)


def test_the_object_tells_which_instance_of_which_app_it_is() -> None:
    body = wanted_object(APP, "amr-07")
    assert body["spec"] == {"app": "teleop", "appUID": "uid-1", "instance": "amr-07", "robot": "amr-07"}
    assert body["metadata"]["labels"] == {
        "robotics.io/app": "teleop",
        "robotics.io/app-uid": "uid-1",
        "robotics.io/instance": "amr-07",
    }
    (owner,) = body["metadata"]["ownerReferences"]
    assert (owner["kind"], owner["uid"], owner["controller"], owner["blockOwnerDeletion"]) == (
        "RobotApp",
        "uid-1",
        True,
        False,
    )


def test_what_was_made_is_as_wanted_and_more_labels_do_no_harm() -> None:
    assert is_as_wanted(stored(), APP, "amr-07")
    more = wanted_object(APP, "amr-07")["metadata"]["labels"] | {"team": "a"}
    assert is_as_wanted(stored(labels=more), APP, "amr-07")
    assert stored().version_number == 12


@pytest.mark.parametrize(
    "meta",
    [
        {"labels": {}},
        {"ownerReferences": []},
        {"ownerReferences": [{"kind": "RobotApp", "name": "teleop", "uid": "uid-2", "controller": True}]},
        {"name": "other"},
        {"namespace": "elsewhere"},
    ],
)
def test_another_owner_name_or_label_is_not(meta: dict[str, Any]) -> None:
    assert not is_as_wanted(stored(**meta), APP, "amr-07")


def test_another_app_or_instance_is_not() -> None:
    assert not is_as_wanted(stored(), make_app(uid="uid-2"), "amr-07")
    assert not is_as_wanted(stored(), APP, "amr-08")


@given(NAMES, NAMES | st.just(""), NAMES | st.sampled_from([*SERVERS, ROUTER, MASTER, PEERS]), NAMES | st.just(""))
def test_no_other_child_has_the_name_of_an_instance(app: str, robot: str, part: str, other: str) -> None:
    assert object_name(app, robot) != child_name(app, other, part)
    if robot != other:
        assert object_name(app, robot) != object_name(app, other)
