"""`migrate -f` of a file that no API server wrote: one line and an exit code, whatever stands where."""

import copy
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.unit.bridge.migration.test_migration import container, deployment

from rigel_bridge.main import main
from rigel_bridge.migration.shape import misshapen

OTHERS = (None, 5, "\x1b[2J", [], {}, [1], {"a": 1}, True, -1)


def objects() -> list[dict[str, Any]]:
    owned = {"name": "p", "namespace": "fleet", "uid": "1", "ownerReferences": [{"uid": "u", "controller": True}]}
    peers = {"shared-data": '{"peer_pods": ["teleop"]}', "affinity": '{"hardware_requirements": [{"type": "usb"}]}'}
    record = {"scheduler.robotics.io/dds-claims": '{"5": "u"}'}
    return [
        deployment(),
        deployment("b", peers),
        {"kind": "Pod", "metadata": owned, "spec": {"containers": [container()], "volumes": [{"name": "v"}]}},
        {"kind": "Node", "metadata": {"name": "n1", "annotations": record}},
        {"kind": "ConfigMap", "metadata": {"name": "robot-fleet-assignments", "namespace": "x"}, "data": {"a": "b"}},
        {"kind": "ReplicaSet", "metadata": {"name": "r", "uid": "rs", "ownerReferences": [{"uid": "uid-teleop"}]}},
    ]


def places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    if path:
        yield path
    for key, child in value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ():
        yield from places(child, (*path, key))


def test_what_the_api_server_writes_is_read() -> None:
    assert [misshapen(each) for each in objects()] == [None] * 6


@pytest.mark.parametrize(
    ("change", "path"),
    [
        (lambda each: each.pop("metadata"), ".metadata"),
        (lambda each: each["spec"]["template"].pop("spec"), ".spec.template.spec"),
        (lambda each: each["spec"]["template"]["spec"].update(containers=[]), ".spec.template.spec.containers"),
        (lambda each: each["spec"].update(replicas=True), ".spec.replicas"),
        (lambda each: each["metadata"].update(labels={"a": 1}), ".metadata.labels.a"),
    ],
)
def test_the_part_that_differs_is_named(change: Any, path: str) -> None:
    each = deployment()
    change(each)
    assert misshapen(each) == path


def test_any_value_at_any_place_ends_in_a_line_and_a_code(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "cluster.json"
    for number, place in enumerate(places(objects())):
        for value in (OTHERS[number % len(OTHERS)], OTHERS[(number * 7 + 3) % len(OTHERS)]):
            changed = copy.deepcopy(objects())
            holder: Any = changed
            for step in place[:-1]:
                holder = holder[step]
            holder[place[-1]] = value
            file.write_text(json.dumps({"items": changed}))
            assert main(["migrate", "-f", str(file)]) in (0, 71, 72), place
            told = capsys.readouterr()
            assert "\x1b" not in told.out + told.err
