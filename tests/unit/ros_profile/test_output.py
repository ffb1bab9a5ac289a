"""The formats: what each holds, what is left out, and that others accept it."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml
from tests.support.rigel.rigelfiles import ONE, rendered
from tests.support.ros_sources import package, python_node, setup_py

from rigel_bridge.render.schema import problems, robotapp_schema
from ros_profile.generate import generate_profile
from ros_profile.model.conclusions import (
    Assessment,
    Estimate,
    Hardware,
    LaunchedNode,
    LaunchProfile,
    PackageProfile,
    Placement,
    Profile,
    QosClass,
    SubClass,
)
from ros_profile.model.facts import Fact, Kind
from ros_profile.output.difference import difference
from ros_profile.output.machine import annotations, as_json, as_rigelfile, from_json, scheduler_block
from ros_profile.output.robotapp import IMAGE, app, as_robotapp
from ros_profile.output.text import text
from ros_profile.output.values import bits, duration, requirement

EVIDENCE = (Fact(Kind.DEVICE_PATH, "/dev/ttyUSB0", "port", "src/driver.py", 12, 0.9),)
DRIVER = Assessment(
    qos_class=Estimate(QosClass.REALTIME, 0.93, EVIDENCE, "It moves a base."),
    sub_class=Estimate(SubClass.MOTION, 0.9),
    deadline_s=Estimate(0.05, 0.8),
    latency_budget_s=Estimate(0.0167, 0.8),
    hardware=(
        Estimate(Hardware("serial", interface="ttyUSB0"), 0.9, EVIDENCE),
        Estimate(Hardware("gpu"), 0.8),
    ),
    doubted=(Estimate(Hardware("can"), 0.3),),
    placement=Estimate(Placement.ROBOT, 0.9),
)
VIEW = Assessment(qos_class=Estimate(QosClass.BEST_EFFORT, 0.7))


def profile(assessment: Assessment = DRIVER, *launches: LaunchProfile) -> Profile:
    return Profile(".", "rules", (PackageProfile("base_driver", ".", 2, assessment, launches=launches),))


def node(name: str, assessment: Assessment = VIEW, **fields: Any) -> LaunchedNode:
    return LaunchedNode(
        name, "base_driver", "driver", fields.pop("plugin", ""), fields.pop("container", ""), assessment, **fields
    )


@pytest.mark.parametrize(
    ("seconds", "written"),
    [
        (0.03, "30ms"),
        (1, "1s"),
        (1.5, "1.5s"),
        (0.0005, "500us"),
        (0.9999, "1s"),
        (0.0333, "33ms"),
        (90, "90s"),
        (1e-9, "1us"),
    ],
)
def test_durations_are_written_as_kubernetes_reads_them(seconds: float, written: str) -> None:
    assert duration(seconds) == written
    assert re.fullmatch(r"([0-9]{1,6}([.][0-9]{1,3})?(us|ms|s|m|h)){1,3}", written)


def test_bandwidth_is_a_quantity() -> None:
    assert [bits(value) for value in (221e6, 1.49e9, 50, 30e9)] == ["221M", "1490M", "50", "30G"]


def test_annotations_hold_what_is_sure_enough_in_the_thesis_fields() -> None:
    found = {key: json.loads(value) for key, value in annotations(DRIVER).items()}
    assert found == {
        "scheduler.robotics.io/policies": {"qos_class": "realtime", "deadline": "50ms", "latency_budget": "17ms"},
        "scheduler.robotics.io/affinity": {"hardware_requirements": [{"type": "serial"}, {"type": "gpu"}]},
    }
    assert annotations(Assessment(None)) == {}


def test_the_rigelfile_block_is_accepted_by_the_bridge() -> None:
    block = yaml.safe_load(as_rigelfile(profile()))["orchestration"]
    file = yaml.safe_load(ONE)
    file["deploy"] = [{"name": "acme/rigel_bridge", "kwargs": {"orchestration": block}}]
    component = rendered(yaml.safe_dump(file)).app["spec"]["components"][0]
    assert component["qosClass"] == "realtime"
    assert component["devices"] == [{"name": "serial", "type": "serial"}]
    assert component["requires"] == [{"type": "gpu"}]


def test_a_node_is_asked_for_what_its_agent_reports_and_for_no_word_of_a_library() -> None:
    camera = Hardware("camera", "realsense", "v4l2")
    assert requirement(camera) == {"type": "video"}
    assert requirement(Hardware("gpu", "nvidia")) == {"type": "gpu", "model": "nvidia"}
    shown = replace(DRIVER, hardware=(Estimate(camera, 0.9),))
    assert "# base_driver: video is opened through realsense v4l2" in as_rigelfile(profile(shown))
    launch = LaunchProfile("base_driver", "a.launch", (node("/cam", shown),), (), shown)
    written = as_robotapp(launch, name="x", distro="jazzy")
    assert "# cam: video is opened through realsense v4l2" in written
    assert yaml.safe_load(written)["spec"]["components"][0]["devices"] == [{"name": "video", "type": "video"}]


def started(text: str, root: Path) -> dict[str, list[str]]:
    """Arguments by component of the RobotApp of a launch file, and its comments under the name #."""
    package(
        root,
        "up",
        {"launch/a.launch.py": f"def generate_launch_description():\n    return LaunchDescription([{text}])\n"},
    )
    written = as_robotapp(generate_profile(root).packages[0].launches[0], name="up", distro="jazzy")
    comments = [line for line in written.splitlines() if line.startswith("#")]
    return {"#": comments} | {one["name"]: one["args"] for one in yaml.safe_load(written)["spec"]["components"]}


def test_a_node_is_started_with_the_arguments_of_its_launch_file(tmp_path: Path) -> None:
    node = "Node(package='tf2_ros', executable='static_transform_publisher', name='t', arguments=['--x', '1', 'a b'])"
    found = started(node, tmp_path)
    assert found["t"] == [
        *["ros2", "run", "tf2_ros", "static_transform_publisher", "--x", "1", "a b"],
        *["--ros-args", "-r", "__node:=t"],
    ]


def test_arguments_that_cannot_be_told_are_a_comment_and_none_is_given(tmp_path: Path) -> None:
    found = started("Node(package='a', executable='b', arguments=['-d', LaunchConfiguration('gone')])", tmp_path)
    assert found["b"] == ["ros2", "run", "a", "b"]
    assert any(line.startswith("# b: is started with arguments that the launch file works out") for line in found["#"])


def test_what_would_end_by_itself_stays_or_is_left_out(tmp_path: Path) -> None:
    spawner = "Node(package='controller_manager', executable='spawner', arguments=['{}'])"
    ending = "Node(package='gazebo_ros', executable='spawn_entity.py', arguments=['-entity', 'r'])"
    found = started(", ".join([spawner.format("one"), spawner.format("two"), ending]), tmp_path)
    assert found["spawner"] == ["ros2", "run", "controller_manager", "spawner", "one", "--unload-on-kill"]
    assert found["spawner-2"] == ["ros2", "run", "controller_manager", "spawner", "two", "--unload-on-kill"]
    assert len(found) == 3
    assert any("spawn_entity.py of gazebo_ros ends by itself and is left out" in line for line in found["#"])


def test_the_flag_that_keeps_a_spawner_stands_in_the_comment_about_its_arguments(tmp_path: Path) -> None:
    unknown = "LaunchConfiguration('gone')"
    spawner = f"Node(package='controller_manager', executable='spawner', arguments=['imu', '-c', {unknown}])"
    (line,) = [line for line in started(spawner, tmp_path)["#"] if "add them to args" in line]
    assert line.endswith("--unload-on-kill")


def test_what_only_the_launch_file_knows_of_a_node_is_named(tmp_path: Path) -> None:
    made = "{'robot_description': Command(['xacro ', 'a.urdf']), 'rate': 20}"
    node = f"Node(package='a', executable='b', namespace=EnvironmentVariable('NS'), parameters=[{made}])"
    found = started(node, tmp_path)
    assert found["b"] == ["ros2", "run", "a", "b", "--ros-args", "-p", "rate:=20"]
    assert any(line.startswith("# b: parameter robot_description is worked out by the launch") for line in found["#"])
    assert any(line.startswith("# b: its namespace is worked out by the launch file") for line in found["#"])


@pytest.mark.parametrize(
    ("parameters", "devices"),
    [((), ["serial"]), ((("channel_type", "tcp"),), []), ((("channel_type", "serial"), ("mode", "udp")), ["serial"])],
)
def test_a_driver_that_goes_over_the_network_gets_no_serial_device(
    parameters: tuple[tuple[str, str], ...], devices: list[str]
) -> None:
    launch = LaunchProfile("base_driver", "a.launch", (node("/lidar", DRIVER, parameters=parameters),), (), DRIVER)
    (made,) = app(launch, name="x", distro="jazzy")["spec"]["components"]
    assert [each["type"] for each in made.get("devices", ())] == devices
    written = as_robotapp(launch, name="x", distro="jazzy")
    assert ("# lidar: no serial device, because of channel_type:=tcp" in written) is (not devices)


def test_drivers_of_which_a_condition_chooses_one_are_named_together() -> None:
    launch = LaunchProfile(
        "base_driver",
        "a.launch.py",
        (node("/one", DRIVER, certain=False), node("/two", DRIVER, certain=False), node("/c", certain=True)),
        (),
        VIEW,
    )
    comments = as_robotapp(launch, name="x", distro="jazzy")
    assert "# one, two: each wants a serial device for itself, under a condition: keep the one" in comments
    assert "# two: is started under a condition that the launch file works out" in comments
    assert "# c: is started under a condition" not in comments


def test_arguments_of_xml_are_split_after_they_are_worked_out(tmp_path: Path) -> None:
    text = '<launch><arg name="who" default="bob"/><node pkg="a" exec="b" args="--to $(var who) x:=y"/></launch>'
    package(tmp_path, "up", {"launch/a.launch.xml": text})
    (launch,) = generate_profile(tmp_path).packages[0].launches
    (found,) = yaml.safe_load(as_robotapp(launch, name="up", distro="jazzy"))["spec"]["components"]
    assert found["args"] == ["ros2", "run", "a", "b", "--to", "bob", "x:=y"]


def test_several_packages_have_a_block_each() -> None:
    two = replace(profile(), packages=(*profile().packages, PackageProfile("viewer", "v", 2, VIEW)))
    found = yaml.safe_load(as_rigelfile(two))["orchestration"]["components"]
    assert found == {
        "base_driver": {"scheduler": scheduler_block(DRIVER)},
        "viewer": {"scheduler": scheduler_block(VIEW)},
    }


def test_json_comes_back_as_it_was() -> None:
    assert from_json(as_json(profile()).encode()) == profile()
    for other in (b"", b"[]", b"{}", b"\xff", b'{"path": 1}'):
        with pytest.raises(ValueError, match="no profile in JSON"):
            from_json(other)


def test_the_text_has_reasons_and_places_on_request() -> None:
    assert "realtime (RT-C, 0.93) · deadline 50ms · budget 17ms · serial ttyUSB0 (0.90)" in text(profile())
    assert "can? (0.30)" in text(profile())
    assert "src/driver.py:12" not in text(profile())
    explained = text(profile(), explain=True)
    assert "class: It moves a base." in explained
    assert "src/driver.py:12  device_path /dev/ttyUSB0 (port)  [0.9]" in explained


@pytest.mark.parametrize("width", [80, 100])
def test_the_text_fits_the_screen_and_breaks_between_values(width: int) -> None:
    long = node("/a_robot/with_a_long_namespace/driver_of_the_front_wheels", DRIVER)
    launch = LaunchProfile("base_driver", "launch/driver.launch.py", (long,), (), DRIVER)
    shown = text(profile(DRIVER, launch), explain=True, width=width)
    assert max(map(len, shown.splitlines())) <= width
    assert " ".join(shown.split()) == " ".join(text(profile(DRIVER, launch), explain=True, width=500).split())
    for value in ("deadline 50ms", "budget 17ms", "(RT-C, 0.93)", "serial ttyUSB0 (0.90)"):
        assert shown.count(value) == text(profile(DRIVER, launch), explain=True, width=500).count(value)


def test_a_difference_names_what_changed_and_nothing_else() -> None:
    slower = replace(DRIVER, deadline_s=Estimate(0.1, 0.5), hardware=())
    assert difference(profile(), profile()) == []
    assert difference(profile(), profile(slower)) == [
        "base_driver: deadline: 50ms -> 100ms",
        "base_driver: hardware: gpu, serial ttyUSB0 -> none",
    ]


def test_a_launch_file_becomes_a_robotapp_that_lacks_images_only(tmp_path: Path) -> None:
    package(
        tmp_path,
        "duo",
        {
            **python_node(
                "talk",
                "self.create_publisher(String, 'chat', QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT))",
            ),
            **python_node("hear", "self.create_subscription(String, 'chat', f, qos_profile_sensor_data)"),
            **setup_py("talk", "hear"),
            "launch/a.launch.py": """
            def generate_launch_description():
                return LaunchDescription([
                    Node(package='duo', executable='talk', name='Left_Talker', namespace='arm', parameters=[{'rate': 5}]),
                    Node(package='duo', executable='hear', remappings=[('chat', 'arm/chat')]),
                    Node(package='rviz2', executable='rviz2')])
        """,
        },
    )
    launch = generate_profile(tmp_path, engine="none").packages[0].launches[0]
    made = app(launch, name="duo", distro="jazzy")
    assert list(problems(made["spec"], robotapp_schema()["properties"]["spec"])) == []
    talk, hear = made["spec"]["components"]
    assert (talk["name"], talk["image"]) == ("left-talker", IMAGE)
    assert talk["args"][:4] == ["ros2", "run", "duo", "talk"]
    assert {"__node:=Left_Talker", "__ns:=/arm", "rate:=5"} <= set(talk["args"])
    assert hear["args"][-1] == "chat:=arm/chat"
    assert made["spec"]["edges"] == [
        {
            "kind": "Topic",
            "topic": "/arm/chat",
            "from": "left-talker",
            "to": "hear",
            "type": "std_msgs/msg/String",
            "qos": {"reliability": "best_effort", "durability": "volatile", "history": "keep_last", "depth": 5},
            "requestedQos": {
                "reliability": "best_effort",
                "durability": "volatile",
                "history": "keep_last",
                "depth": 5,
            },
        }
    ]


def test_a_container_is_one_component_with_the_most_demanding_class_and_all_devices() -> None:
    launch = LaunchProfile(
        "base_driver",
        "a.launch.py",
        (
            node("/box"),
            node("/a", plugin="p::A", container="/box"),
            node("/b", DRIVER, plugin="p::B", container="/box"),
            node("/c"),
        ),
        (),
        VIEW,
    )
    made = app(launch, name="x", distro="jazzy")["spec"]["components"]
    assert [one["name"] for one in made] == ["box", "c"]
    assert (made[0]["qosClass"], made[0]["runsOn"], made[0]["devices"][0]["type"]) == ("realtime", ["Robot"], "serial")
    assert all(f"plugin='{plugin}'" in made[0]["args"][2] for plugin in ("p::A", "p::B"))
    comments = [line for line in as_robotapp(launch, name="x", distro="jazzy").splitlines() if line.startswith("#")]
    assert any("perhaps can (0.30)" in line for line in comments)


def test_names_of_nodes_become_distinct_labels() -> None:
    launch = LaunchProfile("p", "a", (node("/a/cam"), node("/b/cam"), node("/Bad Näme"), node("/$(?)")), (), VIEW)
    names = [one["name"] for one in app(launch, name="x", distro="jazzy")["spec"]["components"]]
    assert names == ["a-cam", "b-cam", "bad-n-me", "node"]


def test_ros_1_starts_nodes_and_nodelets_its_own_way() -> None:
    nodes = (
        node("/a/talk", namespace="/a", remaps=(("chat", "/x"),), parameters=(("rate", "5"),)),
        LaunchedNode("/let", "p", "", "p/Let", "", VIEW),
    )
    made = app(LaunchProfile("p", "a", nodes, (), VIEW), name="x", distro="noetic")["spec"]["components"]
    assert made[0]["args"] == ["rosrun", "base_driver", "driver", "__name:=talk", "__ns:=/a", "chat:=/x", "_rate:=5"]
    assert made[1]["args"] == ["rosrun", "nodelet", "nodelet", "standalone", "p/Let", "__name:=let"]
