"""apply, diff, status, rollback and delete as a user with the role `robotapp-editor` alone, on the real API server."""

import json
from pathlib import Path
from typing import Any

import pytest
from tests.integration.bridge.conftest import USER, Stage
from tests.support.rigelfiles import TWO, orchestration

from robotapp_testbed.failures import CommandError

pytestmark = pytest.mark.live


def rigelfile(folder: Path, stage: Stage, *, image: str = "acme/driver:1", extra: str = "") -> str:
    """A Rigelfile of the app `teleop`, which runs in the stage's own pool."""
    path = folder / "Rigelfile"
    block = f"{{name: teleop, robotapp: {{ros2: {{pool: {stage.pool}}}{extra}}}}}"
    path.write_text(orchestration(block, TWO).replace("acme/driver:1", image))
    return str(path)


def test_an_app_lives_from_apply_to_delete_with_the_rights_of_its_user(
    stage: Stage, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = rigelfile(tmp_path, stage)
    assert stage.run("diff", first) == 1, "all of it is new"
    assert stage.run("apply", first, "--wait", "60s") == 0, capsys.readouterr().err
    stored = stage.app("teleop")
    assert stage.run("apply", first) == stage.run("diff", first) == 0
    assert "teleop in namespace" in (told := capsys.readouterr().out)
    assert told.endswith(": unchanged\n"), "and no line of the diff"
    assert stage.app("teleop")["metadata"]["resourceVersion"] == stored["metadata"]["resourceVersion"]

    second = rigelfile(tmp_path, stage, image="acme/driver:2", extra=", placement: {gang: None}")
    assert stage.run("diff", second) == 1
    assert "+  image: acme/driver:2" in capsys.readouterr().out
    assert stage.run("apply", second) == 0
    assert "spec.components[0].image: acme/driver:1 -> acme/driver:2" in capsys.readouterr().out
    stage.edit("teleop", {"connectivity": {"grace": "9m"}, "placement": {"zones": ["hall-1"]}})
    edited = text(stage.app("teleop")["spec"])

    assert stage.run("rollback", "teleop", "--to", "1", "--wait", "60s") == 0, capsys.readouterr().err
    assert text(stage.app("teleop")["spec"]) == text(stored["spec"]), "what others wrote since is undone too"
    assert stage.run("rollback", "teleop") == 0
    assert text(stage.app("teleop")["spec"]) == edited, "the hand-made spec was kept, and is the last other one"
    assert len(revisions(stage)) == 3
    more(stage, revisions(stage)[-1], first=100, count=8)
    assert stage.run("apply", rigelfile(tmp_path, stage, image="acme/driver:9")) == 0
    kept = revisions(stage)
    assert len(kept) == 10
    uid = stored["metadata"]["uid"]
    assert all(each["metadata"]["ownerReferences"][0]["uid"] == uid for each in kept)
    assert stage.run("rollback", "teleop", "--to", "1") == 76, "the oldest has gone"
    assert stage.run("status", "teleop") in (0, 75)
    assert "(present)" in capsys.readouterr().out

    assert stage.run("delete", "teleop", "--wait", "90s") == 0, capsys.readouterr().err
    assert not [item for kind in ("ra,rai,deploy,pods,services", "controllerrevisions") for item in stage.listed(kind)]
    stage.gone("teleop")
    assert stage.run("delete", "teleop") == 0, "once more is no error"
    assert stage.run("status", "teleop") == 76


def revisions(stage: Stage) -> list[dict[str, Any]]:
    return stage.listed("controllerrevisions")


def more(stage: Stage, like: dict[str, Any], *, first: int, count: int) -> None:
    """Further past specs, as that many applies would have left them."""
    bodies = []
    for number in range(first, first + count):
        metadata = {key: like["metadata"][key] for key in ("namespace", "labels", "ownerReferences")}
        data = {"spec": {**like["data"]["spec"], "schedulerName": f"s{number}"}}
        bodies.append({**like, "metadata": {**metadata, "name": f"teleop-{number}"}, "revision": number, "data": data})
    stage.plane.kubectl("create", "-f", "-", identity=USER, stdin=bodies)


def text(spec: dict[str, Any]) -> str:
    return json.dumps(spec, sort_keys=True)


def test_a_writer_of_robotapps_keeps_no_history_for_statefulsets(stage: Stage) -> None:
    """A StatefulSet makes pods of what its revisions hold: with any account of the namespace."""
    owner = {"apiVersion": "apps/v1", "kind": "StatefulSet", "name": "db", "uid": "u-1", "controller": True}
    ours = owner | {"apiVersion": "robotics.io/v1alpha1", "kind": "RobotApp"}
    beside = owner | {"controller": False}
    for owners, labels in (([owner], {}), ([], {}), ([ours, beside], {}), ([ours], {"app": "db"})):
        body = {
            "apiVersion": "apps/v1",
            "kind": "ControllerRevision",
            "metadata": {"name": "db-1", "namespace": stage.namespace, "ownerReferences": owners, "labels": labels},
            "revision": 1,
            "data": {"spec": {"template": {"spec": {"serviceAccountName": "deployer"}}}},
        }
        with pytest.raises(CommandError, match="is not the past spec of a RobotApp"):
            stage.plane.kubectl("create", "-f", "-", identity=USER, stdin=body)
    body["metadata"] = {"name": "db-1", "namespace": stage.namespace, "labels": {"app": "db"}}
    stage.plane.kubectl("create", "-f", "-", stdin=body)
    with pytest.raises(CommandError, match="is not the past spec of a RobotApp"):
        stage.plane.kubectl("delete", "controllerrevision", "db-1", "-n", stage.namespace, identity=USER)
    stage.plane.kubectl("delete", "controllerrevision", "db-1", "-n", stage.namespace)
