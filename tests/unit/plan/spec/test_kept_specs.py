"""What the operator keeps of objects that tenants write: the text of specs that are ours, few labels, annotations that it reads."""

import json
import tracemalloc
from typing import Any

import msgspec
import pytest

from robotapp_api.model.names import Annotation, Label
from robotapp_operator.plan.spec.objects import MOST_LABELS, MOST_SPEC_BYTES, Deployment, Pod, Service
from robotapp_operator.plan.spec.record import parse_record

UID = "uid-1"
OWNER = {"apiVersion": "robotics.io/v1alpha1", "kind": "RobotApp", "name": "a", "uid": UID, "controller": True}


def body(spec: dict[str, Any], *, owner: dict[str, Any] | None = OWNER, **meta: Any) -> bytes:
    owners = {"ownerReferences": [owner]} if owner else {}
    metadata = {"name": "a", "namespace": "n", "uid": "u", "labels": {Label.APP_UID: UID}, **owners, **meta}
    return json.dumps({"metadata": metadata, "spec": spec}).encode()


@pytest.mark.parametrize("kind", [Deployment, Service])
def test_a_spec_of_ours_reads_as_it_was_written_and_no_reader_changes_it(
    kind: type[Deployment] | type[Service],
) -> None:
    spec = {"replicas": 2, "template": {"spec": {"containers": [{"name": "a", "env": [{"name": "A", "value": "1"}]}]}}}
    item = msgspec.json.decode(body(spec), type=kind)
    assert item.spec == spec
    item.spec["replicas"] = 0
    assert item.spec == spec
    assert item == msgspec.convert(json.loads(body(spec)), kind)


@pytest.mark.parametrize("owner", [None, OWNER | {"uid": "another"}, OWNER | {"controller": False}])
def test_nothing_is_kept_of_the_spec_of_an_object_that_no_app_controls(owner: dict[str, Any] | None) -> None:
    item = msgspec.json.decode(body({"replicas": 2}, owner=owner), type=Deployment)
    assert (item.spec, item.text) == ({}, b"")


def test_nothing_is_kept_of_a_spec_that_is_longer_than_ours_can_be() -> None:
    item = msgspec.json.decode(body({"paused": "x" * MOST_SPEC_BYTES}), type=Deployment)
    assert item.text == b""


def test_of_too_many_labels_ours_stay() -> None:
    many = {f"x{index}": "" for index in range(MOST_LABELS)} | {Label.APP_UID: UID, Label.INSTANCE: "r"}
    item = msgspec.json.decode(body({}, labels=many), type=Pod)
    assert item.metadata.labels == {Label.APP_UID: UID, Label.INSTANCE: "r"}
    few = {"x": "", Label.APP_UID: UID}
    assert msgspec.json.decode(body({}, labels=few), type=Pod).metadata.labels == few


def test_annotations_of_others_are_not_kept() -> None:
    given = {"a": "x" * 200_000, Annotation.MOVES.value: "m"}
    item = msgspec.json.decode(body({}, annotations=given), type=Deployment)
    assert item.metadata.annotations == {Annotation.MOVES: "m"}
    app = {"metadata": {"name": "a", "uid": "u", "annotations": {"a": "x", Annotation.APPROVE_UPDATE.value: "1"}}}
    record = parse_record(app | {"spec": {"ros": {"distro": "humble"}, "components": [{"name": "a", "image": "x"}]}})
    assert record.app is not None
    assert record.app.annotations == {Annotation.APPROVE_UPDATE: "1"}


def test_a_deployment_with_a_long_environment_takes_about_its_text() -> None:
    env = [{"name": f"A{index}", "value": ""} for index in range(2000)]
    text = body({"template": {"spec": {"containers": [{"name": "a", "env": env}]}}})
    decoder = msgspec.json.Decoder(Deployment)
    tracemalloc.start()
    items = [decoder.decode(text) for _ in range(20)]
    taken, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert taken < 1.3 * len(items) * len(text)
