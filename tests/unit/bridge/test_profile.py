"""`--profile`: what the file leaves open is inferred from the sources, marked, and never laid over what was written."""

import sys
from pathlib import Path

import pytest
import yaml
from tests.support.rigel.rigelfiles import ONE, TWO, orchestration
from tests.support.ros_sources import package, write

from rigel_bridge import inferences, source
from rigel_bridge.document.failures import BridgeError
from rigel_bridge.main import main
from rigel_bridge.render.inferred import ANNOTATION, Inference
from rigel_bridge.render.schema import problems, robotapp_schema
from rigel_bridge.source import Objects, Source, objects

DRIVER = Inference(
    {"qosClass": "realtime", "runsOn": ["Robot"], "devices": [{"name": "serial", "type": "serial"}]},
    0.93,
    ("gpu (0.41)",),
)


def filled(root: Path, text: str, monkeypatch: pytest.MonkeyPatch, **known: Inference) -> Objects:
    monkeypatch.setattr(source, "inferences", lambda _: known)
    return objects(Source(write(root, {"Rigelfile": text}) / "Rigelfile", profile=root))


def test_open_fields_are_filled_and_marked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = filled(tmp_path, TWO, monkeypatch, base_driver=DRIVER)
    driver, ui = found.apps[0]["spec"]["components"]
    assert {key: driver[key] for key in DRIVER.fields} == DRIVER.fields
    assert "qosClass" not in ui
    assert (
        found.apps[0]["metadata"]["annotations"][ANNOTATION]
        == "base-driver.qosClass base-driver.runsOn base-driver.devices"
    )
    assert found.remarks == (
        "base-driver: qosClass, runsOn, devices inferred from its source (confidence 0.93)",
        "base-driver: perhaps needs gpu (0.41): left out, a wrong device keeps the pod pending",
        "operator-ui: no package operator_ui among the sources: nothing inferred",
    )


@pytest.mark.parametrize(
    "block",
    [
        "scheduler: {policies: {qos_class: best_effort}}",
        "components: {base_driver: {scheduler: {policies: {qos_class: best_effort}}}}",
    ],
)
def test_a_scheduler_block_is_left_as_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: str) -> None:
    found = filled(tmp_path, orchestration(block), monkeypatch, base_driver=DRIVER)
    component = found.apps[0]["spec"]["components"][0]
    assert component["qosClass"] == "best_effort"
    assert "devices" not in component
    assert ANNOTATION not in found.apps[0]["metadata"]["annotations"]
    assert found.remarks == ("base-driver: has a scheduler block: nothing inferred",)


def test_a_field_in_the_apis_words_stays_and_the_others_are_filled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = filled(
        tmp_path, orchestration("components: {base_driver: {runsOn: [Edge]}}"), monkeypatch, base_driver=DRIVER
    )
    component = found.apps[0]["spec"]["components"][0]
    assert (component["runsOn"], component["qosClass"]) == (["Edge"], "realtime")


def test_the_remarks_stand_as_comments_above_the_app(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(source, "inferences", lambda _: {"base_driver": DRIVER})
    file = write(tmp_path, {"Rigelfile": ONE}) / "Rigelfile"
    assert main(["render", str(file), "--name", "app", "--profile", str(tmp_path)]) == 0
    written = capsys.readouterr().out
    assert written.startswith("# base-driver: qosClass, runsOn, devices inferred from its source (confidence 0.93)\n")
    assert yaml.safe_load(written)["spec"]["components"][0]["qosClass"] == "realtime"


def test_sources_are_read_by_package_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    package(tmp_path / "ws", "base_driver", {"driver.py": "import rospy\n"})
    assert set(inferences.inferences(tmp_path / "ws")) == {"base_driver"}
    for missing in ("nothing", "cache"):
        (tmp_path / "cache").mkdir(exist_ok=True)
        with pytest.raises(BridgeError) as caught:
            inferences.inferences(tmp_path / missing)
        assert str(caught.value).startswith(str(tmp_path / missing))


def test_a_base_driver_in_python_becomes_realtime_with_its_serial_line(tmp_path: Path) -> None:
    node = """
        import rclpy, serial
        from rclpy.node import Node
        from geometry_msgs.msg import Twist
        class Base(Node):
            def __init__(self):
                super().__init__('base')
                self.port = serial.Serial(self.declare_parameter('port', '/dev/ttyUSB0').value)
                self.create_subscription(Twist, 'cmd_vel', self.drive, 10)
                self.create_timer(0.05, self.send)
    """
    package(
        tmp_path / "ws",
        "base_driver",
        {"base_driver/base.py": node},
        depends=("rclpy", "geometry_msgs", "python3-serial"),
    )
    file = write(tmp_path, {"Rigelfile": ONE}) / "Rigelfile"
    app = objects(Source(file, profile=tmp_path / "ws")).apps[0]
    driver = app["spec"]["components"][0]
    assert (driver["qosClass"], driver["runsOn"]) == ("realtime", ["Robot"])
    assert driver["policies"]["deadline"] == "50ms"
    assert [device["type"] for device in driver["devices"]] == ["serial"]
    assert list(problems(app["spec"], robotapp_schema()["properties"]["spec"])) == []


def test_without_the_profiler_the_message_names_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "ros_profile.generate", None)
    with pytest.raises(BridgeError, match=r"pip install '\.\[profile\]' in a clone"):
        inferences.inferences(tmp_path)


def test_a_terminal_sees_the_progress_and_a_pipe_does_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    package(tmp_path, "base_driver", {})
    inferences.inferences(tmp_path)
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    inferences.inferences(tmp_path)
    shown = capsys.readouterr().err
    assert "base_driver" in shown
    assert shown.endswith("\r\x1b[K")


def test_a_file_in_place_of_the_sources_is_told(tmp_path: Path) -> None:
    (tmp_path / "package.xml").write_text("")
    with pytest.raises(BridgeError, match="is no folder; give that of a package or of a workspace"):
        inferences.inferences(tmp_path / "package.xml")
