"""Tuning the scheduler in a browser: two weights are changed, tried, applied, at work, and taken back."""

import html
import json
import re
import secrets
from collections.abc import Iterator

import pytest
import yaml
from tests.live.console.browsing import Console, serve

from campaigns.rigs.stage import Stage, nodes, pod
from robotapp_console.tuning.form import build_form, fill_form
from robotapp_scheduler.config.editing import read_document
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane.product import start_scheduler
from robotapp_testbed.machines.nodes import edge
from robotapp_testbed.processes.process import Process

pytestmark = pytest.mark.live
SYSTEM = "/api/v1/namespaces/robotapp-system/configmaps"
NAME = "robotapp-scheduler"
HEAD = {"apiVersion": "kubescheduler.config.k8s.io/v1", "kind": "KubeSchedulerConfiguration"}
SPREAD = ("NodeResourcesBalancedAllocation", "ImageLocality")


def write_config() -> str:
    """Two scores compete: the emptier node, and the node that a preferred affinity wishes."""
    profile = {
        "schedulerName": "ros-aware-scheduler",
        "plugins": {
            "multiPoint": {"disabled": [{"name": name} for name in SPREAD]},
            "score": {"enabled": [{"name": "NodeResourcesFit", "weight": 10}, {"name": "NodeAffinity", "weight": 1}]},
        },
    }
    return yaml.safe_dump(HEAD | {"profiles": [profile]}, sort_keys=False)


@pytest.fixture
def config_text(installed_plane: ControlPlane) -> Iterator[str]:
    before = installed_plane.api.get(f"{SYSTEM}/{NAME}")["data"]
    text = write_config()
    installed_plane.api.patch(f"{SYSTEM}/{NAME}", {"data": {"scheduler.yaml": text}})
    installed_plane.api.patch(f"{SYSTEM}/{NAME}-history", {"data": None})
    yield text
    installed_plane.api.patch(f"{SYSTEM}/{NAME}", {"data": before})
    installed_plane.api.patch(f"{SYSTEM}/{NAME}-history", {"data": None})


@pytest.fixture
def scheduler(installed_plane: ControlPlane, config_text: str) -> Iterator[Process]:
    process = start_scheduler(
        installed_plane,
        name=f"scheduler-{secrets.token_hex(3)}",
        config_map=NAME,
        last_good_config_map=f"{NAME}-last-good",
        sweep_seconds=1,
        log_format="text",
    )
    Stage.wait(lambda: read_map(installed_plane, f"{NAME}-last-good") == config_text, what=process.log_text)
    yield process
    process.stop()


@pytest.fixture
def console(installed_plane: ControlPlane, scheduler: Process) -> Iterator[Console]:
    with serve(installed_plane, f"--scheduler-url={scheduler.health_url}") as console:
        yield console


def read_map(plane: ControlPlane, name: str) -> str:
    return str((plane.api.get(f"{SYSTEM}/{name}").get("data") or {}).get("scheduler.yaml", ""))


def make_tuner(plane: ControlPlane, namespace: str, *roles: str) -> str:
    """Returns the token of an account that may look at the cluster and, with these Roles, do more."""
    plane.kubectl("create", "serviceaccount", "tuner", "-n", namespace)
    account = f"--serviceaccount={namespace}:tuner"
    for role in ("view", "robotapp-cluster-viewer"):
        plane.kubectl("create", "clusterrolebinding", f"{namespace}-{role}", f"--clusterrole={role}", account)
    for role in roles:
        plane.kubectl(
            "create", "rolebinding", f"{namespace}-{role}", "-n", "robotapp-system", f"--role={role}", account
        )
    return plane.kubectl("create", "token", "tuner", "-n", namespace).strip()


def take_away(plane: ControlPlane, namespace: str) -> None:
    for role in ("view", "robotapp-cluster-viewer"):
        plane.kubectl("delete", "clusterrolebinding", f"{namespace}-{role}", "--ignore-not-found")
    plane.kubectl(
        "delete", "rolebinding", f"{namespace}-robotapp-scheduler-tuner", "-n", "robotapp-system", "--ignore-not-found"
    )


def read_hidden(page: str, name: str) -> str:
    match = re.search(rf'name="{name}" value="([^"]*)"', page)
    assert match is not None, name
    return html.unescape(match[1])


def fill(page: str, **changes: str) -> dict[str, str]:
    base = read_hidden(page, "base")
    fields = fill_form(build_form(read_document(base))) | {"base": base, "complete": "1", "replay": "100"}
    fields |= {name: read_hidden(page, name) for name in ("csrf", "version")}
    return fields | {name.replace("__", "-"): value for name, value in changes.items()}


def wish_for(node: str) -> dict[str, object]:
    """A pod that would rather be on this node."""
    term = {"matchExpressions": [{"key": "kubernetes.io/hostname", "operator": "In", "values": [node]}]}
    preferred = [{"weight": 100, "preference": term}]
    return {"affinity": {"nodeAffinity": {"preferredDuringSchedulingIgnoredDuringExecution": preferred}}}


HEAVIER = {"p0__weight__NodeAffinity": "50", "p0__weight__NodeResourcesFit": "1"}


def test_two_weights_are_tried_applied_at_work_and_taken_back(
    installed_plane: ControlPlane, namespace: str, console: Console, config_text: str
) -> None:
    stage = Stage(installed_plane, namespace)
    token = make_tuner(installed_plane, namespace, "robotapp-scheduler-tuner")
    try:
        with nodes(installed_plane, edge("edge-full", cpu="4"), edge("edge-empty", cpu="4")):
            stage.create_pod(pod("load", requests={"cpu": "3"}, nodeSelector={"kubernetes.io/hostname": "edge-full"}))
            assert stage.wait_bound("load") == "edge-full"
            place(stage, "before", "edge-empty")
            assert console.sign_in(token) == 303
            page = try_weights(console)
            assert read_map(installed_plane, NAME) == config_text, "trying changes nothing"
            assert follow(console, fill(page, **HEAVIER, action="apply")).count('data-state="running"') == 1
            assert "weight: 50" in read_map(installed_plane, NAME)
            place(stage, "after", "edge-full")
            page = console.get("/scheduler")[1]
            assert f"system:serviceaccount:{namespace}:tuner" in page.partition('id="versions"')[2]
            undo = {"csrf": read_hidden(page, "csrf"), "version": read_hidden(page, "version"), "action": "undo"}
            assert 'data-state="running"' in follow(console, undo)
            assert read_map(installed_plane, NAME) == config_text
            place(stage, "undone", "edge-empty")
    finally:
        take_away(installed_plane, namespace)


def place(stage: Stage, name: str, node: str) -> None:
    """Creates a pod that wishes to be on the full node, and asserts where it goes."""
    stage.create_pod(pod(name, requests={"cpu": "100m"}, **wish_for("edge-full")))
    assert stage.wait_bound(name) == node


def try_weights(console: Console) -> str:
    """Enters a mistake, then the two weights, and replays; returns the page of the form."""
    status, page = console.get("/scheduler")
    assert status == 200
    assert 'data-state="running"' in page
    assert 'id="apply"' in page
    _, wrong = console.post("/scheduler", fill(page, p0__arg__LatencyFilter__maxLatency="soon"))
    assert 'data-problem-of="p0-arg-LatencyFilter-maxLatency"' in wrong
    _, replay = console.post("/scheduler", fill(page, **HEAVIER, action="replay"))
    assert 'data-judged="2" data-moved="1"' in replay, re.findall(r'id="message".*', replay)
    row = re.search(r'<tr><th scope="row">[^<]*/before</th>.*', replay)
    assert row is not None
    assert re.search(r"edge-empty</td><td>edge-full</td>", row[0])
    assert "NodeAffinity +" in row[0]
    return page


def follow(console: Console, fields: dict[str, str]) -> str:
    """Presses a button that writes, and returns the page that the browser is sent to."""
    status, answer = console.post("/scheduler", fields)
    assert status == 303, re.findall(r'id="message".*', answer)
    return console.get("/scheduler?applied=1")[1]


def test_without_the_role_it_is_read_only_and_a_write_is_refused(
    installed_plane: ControlPlane, namespace: str, console: Console, config_text: str
) -> None:
    token = make_tuner(installed_plane, namespace)
    try:
        assert console.sign_in(token) == 303
        _, page = console.get("/scheduler")
        assert 'id="read-only"' in page
        assert 'id="apply"' not in page
        status, answer = console.post("/scheduler", fill(page, **HEAVIER, action="apply"))
        assert status == 403
        assert "You may not change it" in answer
        assert read_map(installed_plane, NAME) == config_text
        status, config = console.get("/api/config")
        assert (status, json.loads(config)["mayWrite"]) == (200, False)
    finally:
        take_away(installed_plane, namespace)
