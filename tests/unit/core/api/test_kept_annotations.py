"""What of an object's annotations the scheduler keeps: a tenant's many cost no memory, those that rules read stay."""

import json
import tracemalloc
from typing import Any

import msgspec
import pytest

from robotapp_api.model.names import Annotation
from robotapp_scheduler.core.api.core_v1 import Node, Pod
from robotapp_scheduler.core.api.kept_annotations import MOST_CHARACTERS, MOST_KEYS, SELECTED_NODE
from robotapp_scheduler.core.api.storage_v1 import Claim

MANY = {f"x{index}": "" for index in range(18_000)}
LONG = {"kubectl.kubernetes.io/last-applied-configuration": "x" * (MOST_CHARACTERS + 1)}
POLICIES = {Annotation.POLICIES.value: "{}"}


def body(annotations: dict[str, str]) -> bytes:
    return json.dumps({"metadata": {"name": "a", "uid": "u", "annotations": annotations}}).encode()


def decode(as_type: Any, annotations: dict[str, str]) -> dict[str, str]:
    found: dict[str, str] = msgspec.json.decode(body(annotations), type=as_type).metadata.annotations
    return found


@pytest.mark.parametrize("others", [MANY, LONG], ids=["many", "long"])
def test_of_many_or_long_annotations_those_stay_that_a_rule_reads(others: dict[str, str]) -> None:
    assert decode(Pod, others | POLICIES) == POLICIES
    assert decode(Claim, others | {SELECTED_NODE: "n"}) == {SELECTED_NODE: "n"}


def test_a_usual_object_keeps_all_for_plugins_of_others() -> None:
    few = {f"lab.example/{index}": "x" for index in range(MOST_KEYS)}
    assert decode(Node, few) == few


def test_annotations_below_our_domain_that_nobody_reads_are_no_exception() -> None:
    assert decode(Pod, {f"a{index}.robotics.io/b": "" for index in range(MOST_KEYS + 1)}) == {}


def test_eighty_pods_with_a_quarter_of_a_megabyte_of_annotations_take_little() -> None:
    text = body(MANY)
    decoder = msgspec.json.Decoder(Pod)
    tracemalloc.start()
    pods = [decoder.decode(text) for _ in range(80)]
    taken, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(pods) == 80
    assert taken < 1_000_000
