"""Which node the agent belongs to."""

import base64
import json
from pathlib import Path
from typing import Any

import pytest

from robotapp_agent.shell.own_node import OwnNode, UnknownNodeError, node_of_token, own_node


def token(claims: Any) -> str:
    payload = base64.urlsafe_b64encode(json.dumps(claims).encode()).decode().rstrip("=")
    return f"e30.{payload}.c2lnbmF0dXJl"


def bound(name: str = "robot-1", uid: str = "u-1") -> str:
    return token({"kubernetes.io": {"namespace": "robotapp-agent", "node": {"name": name, "uid": uid}}})


def test_the_token_tells_the_name_and_the_uid_of_its_node() -> None:
    assert node_of_token(bound()) == OwnNode("robot-1", "u-1")


@pytest.mark.parametrize(
    "text",
    [
        "",
        "a.b",
        "a.b.c",
        "a.!!!.c",
        "a..c",
        token([]),
        token({}),
        token({"kubernetes.io": {}}),
        token({"kubernetes.io": {"node": 3}}),
    ],
)
def test_another_text_tells_no_node(text: str) -> None:
    assert node_of_token(text) is None


def test_a_new_token_tells_the_uid_of_the_node_that_was_made_again(tmp_path: Path) -> None:
    file = tmp_path / "token"
    for uid in ("u-1", "u-2"):
        file.write_text(bound(uid=uid))
        assert own_node(file, flag="", environment="robot-1") == OwnNode("robot-1", uid)


def test_without_a_bound_token_the_name_is_given_and_the_uid_unknown(tmp_path: Path) -> None:
    assert own_node(None, flag="robot-1", environment="robot-2") == OwnNode("robot-1")
    assert own_node(tmp_path / "none", flag="", environment="robot-2") == OwnNode("robot-2")
    with pytest.raises(UnknownNodeError, match=r"NODE_NAME to spec\.nodeName"):
        own_node(tmp_path / "none", flag="", environment="")


def test_a_name_that_contradicts_the_token_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "token"
    file.write_text(bound("robot-1"))
    with pytest.raises(UnknownNodeError, match=r"NODE_NAME is robot-2, but .* on robot-1"):
        own_node(file, flag="", environment="robot-2")
