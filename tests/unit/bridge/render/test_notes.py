"""Every note of a rendering is true of the form that is written: of a RobotApp, of annotated pods, of plain manifests."""

import ast
import sys
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from tests.support.rigel.jobfiles import with_block
from tests.support.rigel.rigelfiles import ONE, TWO, orchestration, rendered

from rigel_bridge import render
from rigel_bridge.main import main
from rigel_bridge.render.notes import Note
from rigel_bridge.render.schema import robotapp_schema
from rigel_bridge.render.workloads import FORMATS, workloads

NOETIC = ONE.replace("humble", "noetic")


class Case(NamedTuple):
    """A Rigelfile, the notes it has as a RobotApp, and where they differ those as pods and manifests: parts of each, in order."""

    text: str
    app: tuple[str, ...]
    pods: tuple[str, ...] | None = None
    manifests: tuple[str, ...] | None = None

    def notes(self, form: str) -> tuple[str, ...]:
        found = {"robotapp": self.app, "pods": self.pods, "manifests": self.manifests}[form]
        return self.app if found is None else found


def noetic(text: str) -> str:
    return text.replace("distro: humble", "distro: noetic")


def container(field: str) -> str:
    """With additional fields of the application's container."""
    template = f"{{template: {{spec: {{containers: [{{{field}}}]}}}}}}"
    return with_block(f"{{additional_k8s_params: {{application: {{spec: {template}}}}}}}")


OF_ITS_OWN = "the app gets a domain of its own"
LAPTOPS = "ROS_DOMAIN_ID is 0, which every laptop uses: write dds_domain"
UPDATE = "{rolling_update: {strategy: Rolling, max_surge: 1}}"
DEPLOYMENT = "{additional_k8s_params: {application: {metadata: {name: x}, spec: {selector: {}, strategy: {}}}}}"
PLAIN_DEPLOYMENT = (
    "names and labels follow from those of the app",
    "it follows from the names of the app",
    "write rolling_update, which plain objects keep",
)
MASTER = "{additional_k8s_params: {ros_master: {spec: {}}}}"
CASES = {
    "surge": Case(with_block(UPDATE), ("--format pods and manifests keep it",), (), (LAPTOPS,)),
    "recreate": Case(with_block("{rolling_update: {strategy: Recreate}}"), (), (), (LAPTOPS,)),
    "folder of a node": Case(
        with_block("{dds_domain: 7, persistent_storage: {volumes: [{name: v, size: 1Gi, host_path: /v}]}}"),
        ("which folder of a node a volume is, its administrator decides",),
    ),
    "observability": Case(
        with_block("{dds_domain: 7, observability: {enabled: true}}"),
        ("metrics of all apps come with the chart",),
        ("plain objects have no metrics of their own",),
        ("plain objects have no metrics of their own",),
    ),
    "deployment": Case(
        with_block(DEPLOYMENT),
        ("the operator names and labels what it makes", "the operator decides it", "the operator decides it"),
        PLAIN_DEPLOYMENT,
        (*PLAIN_DEPLOYMENT, LAPTOPS),
    ),
    "master": Case(
        noetic(with_block(MASTER)),
        ("RMW_IMPLEMENTATION has no meaning for ROS 1", "the operator runs the master"),
        ("RMW_IMPLEMENTATION has no meaning for ROS 1", "the master's objects are the same for every app"),
        ("RMW_IMPLEMENTATION has no meaning for ROS 1", "the master's objects are the same for every app"),
    ),
    "domain 0": Case(container("env: [{name: ROS_DOMAIN_ID, value: 0}]"), (OF_ITS_OWN,), (), (LAPTOPS,)),
    "ROS 2's variables in the block of ROS 1": Case(
        noetic(container("env: [{name: ROS_DOMAIN_ID, value: 3}]")),
        ("RMW_IMPLEMENTATION has no meaning", "ROS_DOMAIN_ID has no meaning for ROS 1"),
    ),
    "master's address": Case(
        noetic(container("env: [{name: ROS_MASTER_URI, value: 'http://ros-master:11311'}]")),
        ("RMW_IMPLEMENTATION", "ROS_MASTER_URI is left out: the operator sets it"),
        ("RMW_IMPLEMENTATION", "ROS_MASTER_URI is left out: each pod gets ROS_MASTER_URI and ROS_IP"),
        ("RMW_IMPLEMENTATION", "ROS_MASTER_URI is left out: each pod gets ROS_MASTER_URI and ROS_IP"),
    ),
    "master's address in ROS 2": Case(
        container("env: [{name: ROS_IP, value: 10.0.0.1}]"),
        ("ROS_IP is left out: ROS 2 does not read it",),
        None,
        ("ROS_IP is left out: ROS 2 does not read it", LAPTOPS),
    ),
    "master in ROS 2": Case(
        orchestration("{dds_domain: 7, deploy_ros_master: true}"), ("which has no master: none is deployed",)
    ),
    "secret": Case(
        orchestration("{dds_domain: 7}", ONE + "    env: [{name: API_TOKEN, value: x}]\n"), ("looks like a secret",)
    ),
    "the base image's variables": Case(
        orchestration("{dds_domain: 7}", ONE + "    env: [{name: PATH, value: '/opt/bin:$PATH'}]\n"),
        ("env PATH refers to $PATH, which the base image states",),
    ),
    "namespace": Case(orchestration("{dds_domain: 7, namespace: lab}"), ("the command line names the namespace",)),
    "login": Case(
        orchestration("{dds_domain: 7}", ONE + "    registry: {server: r.io, username: u, password: p}\n"),
        ("r.io needs a login",),
    ),
    "mark": Case(
        orchestration("{dds_domain: 7}", ONE.replace("base_driver driver", "base_driver '{{ x | y }}'")),
        ("keeps its {{ }}",),
    ),
    "end of life": Case(NOETIC, ("noetic had its end of life",)),
    "two pods": Case(TWO, (), (LAPTOPS,), (LAPTOPS,)),
}


def noted(case: Case, form: str) -> tuple[str, ...]:
    today = "2026-11-22" if case.text is NOETIC else ""
    found = rendered(case.text, today=today)
    return found.notes if form == "robotapp" else workloads(found, annotated=form == "pods")[1]


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("name", CASES)
def test_the_notes_are_those_of_the_form(name: str, form: str) -> None:
    found, wanted = noted(CASES[name], form), CASES[name].notes(form)
    assert len(found) == len(wanted), found
    for note, part in zip(found, wanted, strict=True):
        assert part in note
    if form == "robotapp":
        assert not any("plain objects have" in note for note in found)
    else:
        assert not any("the operator" in note for note in found if "needs the operator" not in note)


def test_no_note_is_missing_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each place in the code that makes a note made one in a case."""
    made: set[tuple[str, int]] = set()

    def recorded(self: Note, text: str, plain: str | None = None) -> None:
        frame = sys._getframe(1)
        made.add((frame.f_code.co_filename, frame.f_lineno))
        object.__setattr__(self, "text", text)
        object.__setattr__(self, "plain", plain)

    monkeypatch.setattr(Note, "__init__", recorded)
    for case in CASES.values():
        noted(case, "robotapp")
    for path in sorted(Path(render.__file__).parent.glob("*.py")):
        for call in ast.walk(ast.parse(path.read_text())):
            if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == "Note":
                lines = range(call.lineno, (call.end_lineno or call.lineno) + 1)
                assert any((str(path), line) in made for line in lines), (
                    f"{path.name}:{call.lineno}: no case has this note"
                )


EVERY_FIELD: dict[str, Any] = {
    "ros2": {"pool": "lab", "discovery": {"mode": "Server"}, "rmw": "rmw_fastrtps_cpp", "domain": 7},
    "placement": {"zones": ["z"], "masterNode": "n", "gang": "All"},
    "connectivity": {"grace": "1m"},
}


def test_what_plain_objects_have_no_place_for_is_noted_field_by_field() -> None:
    found = rendered(ONE)
    device = {"name": "usb", "type": "usb", "usbID": "8086:0b3a"}
    component = {**found.app["spec"]["components"][0], "qosClass": "realtime", "devices": [device], "parameters": []}
    app = {**found.app, "spec": {**found.app["spec"], **EVERY_FIELD, "components": [component]}}
    changed = type(found)(app, (), {}, (), (), found.origin)
    everywhere = {"connectivity", "ros2.pool", "ros2.discovery", "components[0].parameters"}
    for annotated, more in (
        (True, {"placement.gang", "components[0].devices[0].usbID"}),
        (False, {"placement", "components[0].qosClass", "components[0].devices"}),
    ):
        _, notes = workloads(changed, annotated=annotated)
        lost = {note.split("spec.")[1].split()[0] for note in notes if "needs the operator" in note}
        assert lost == everywhere | more


def test_a_field_that_the_api_gains_is_noted_until_it_is_carried() -> None:
    """The lists name what is carried, so a new field of the definition is lost with a note, never in silence."""
    spec = robotapp_schema()["properties"]["spec"]["properties"]
    found = rendered(ONE)
    for field in {*spec} - {"ros", "ros1", "ros2", "components", "schedulerName"}:
        changed = type(found)({**found.app, "spec": {**found.app["spec"], field: {}}}, (), {}, (), (), found.origin)
        assert any(f"spec.{field} needs the operator" in note for note in workloads(changed, annotated=False)[1]), field


@pytest.mark.parametrize(("form", "expected"), [("robotapp", True), ("pods", False), ("manifests", False)])
def test_the_command_prints_the_notes_of_its_format(
    form: str, expected: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "Rigelfile"
    path.write_text(with_block(UPDATE))
    assert main(["render", str(path), "--format", form]) == 0
    assert ("a RobotApp replaces a pod" in capsys.readouterr().err) is expected
