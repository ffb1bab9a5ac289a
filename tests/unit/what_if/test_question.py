"""What a question may be, and what is said about one that cannot be answered."""

import contextlib
import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotapp_scheduler.what_if.question import (
    MOST_BODY,
    MOST_NODES,
    Question,
    QuestionError,
    UnknownNodeError,
    check_nodes,
    parse,
)

APP = {"apiVersion": "robotics.io/v1alpha1", "kind": "RobotApp", "metadata": {"name": "a", "namespace": "team"}}
PAIR = {"one": "n1", "other": "n2", "rtt": "40ms"}


def asked(**fields: Any) -> Question:
    return parse(json.dumps(fields).encode())


def refusal(**fields: Any) -> str:
    with pytest.raises(QuestionError) as error:
        asked(**fields)
    return str(error.value)


def test_nodes_pairs_apps_and_a_configuration_are_asked_about_at_once() -> None:
    question = asked(nodeLoss=["n3"], rtt=[PAIR], apps=[APP], config={"kind": "x"})
    assert question.nodes == ["n3", "n1", "n2"]
    assert question.rtt[0].us == 40_000
    assert question.names == [("team", "a")]


def test_a_replay_is_asked_with_a_configuration_alone() -> None:
    assert asked(config={"kind": "x"}, replay=500).replay == 500
    assert "from 0 to 500 placements" in refusal(config={"kind": "x"}, replay=501)
    assert "from 0 to 500 placements" in refusal(config={"kind": "x"}, replay=-1)
    assert "with nothing else" in refusal(config={"kind": "x"}, replay=1, nodeLoss=["n1"])
    assert "with nothing else" in refusal(apps=[APP], replay=1)


def test_every_mistake_is_named_with_its_place_and_what_is_allowed() -> None:
    assert "nothing is asked" in refusal()
    assert "$.nodeLoss" in refusal(nodeLoss="n1")
    assert "unknown field `nodes`" in refusal(nodes=["n1"])
    assert "at most 50 are allowed" in refusal(nodeLoss=["n"] * (MOST_NODES + 1))
    assert "rtt[1] names n1 twice" in refusal(rtt=[PAIR, {**PAIR, "other": "n1"}])
    assert "rtt[0].rtt: '40' is not a duration; write for example 250us, 30ms" in refusal(rtt=[{**PAIR, "rtt": "40"}])
    assert "apps[0] is Pod of v1; only RobotApps" in refusal(apps=[{"apiVersion": "v1", "kind": "Pod"}])
    assert "apps[0].metadata.namespace: is missing" in refusal(apps=[{**APP, "metadata": {"name": "a"}}])
    assert "RobotApp team/a is given twice" in refusal(apps=[APP, APP])


def test_a_body_that_is_too_long_or_nested_too_deep_is_refused() -> None:
    for body in (b" " * (MOST_BODY + 1), b'{"config":' + b'{"a":' * 100_000, b"\xff", b"[]", b""):
        with pytest.raises(QuestionError):
            parse(body)


@given(st.binary(max_size=200))
def test_no_body_is_anything_but_a_question_or_a_refusal(body: bytes) -> None:
    with contextlib.suppress(QuestionError):
        parse(body)


def test_an_unknown_node_is_named_with_those_that_were_probably_meant() -> None:
    with pytest.raises(UnknownNodeError, match="there is no node 'edge-l' among 2: did you mean edge-1"):
        check_nodes(asked(nodeLoss=["edge-l"]), ["edge-1", "amr"])
    with pytest.raises(UnknownNodeError, match="kubectl robotapp nodes"):
        check_nodes(asked(rtt=[{**PAIR, "other": "zzz"}]), ["n1"])
    check_nodes(asked(rtt=[PAIR], nodeLoss=["n1"]), ["n1", "n2"])
