"""What a component starts and what it calls its devices, as far as the words alone tell that it will not work."""

import json
from typing import Any

import pytest
from tests.support.factories import component, make_app

from robotapp_api.checks.spec import spec_notes, spec_problems

INLINE = [{"inline": "/**: {ros__parameters: {rate: 20.0}}"}]
LIDAR = "$(ROBOTAPP_DEVICE_LIDAR)"


def list_problems(**fields: Any) -> list[str]:
    return [str(problem) for problem in spec_problems(make_app(component(**fields)).spec)]


def list_notes(**fields: Any) -> list[str]:
    return [str(note) for note in spec_notes(make_app(component(**fields)).spec)]


@pytest.mark.parametrize(
    "fields",
    [
        {"args": ["driver", "--port", LIDAR]},
        {"command": ["driver", f"--port={LIDAR}"]},
        {"args": ["driver"], "env": [{"name": "PORT", "value": LIDAR}]},
        {
            "args": ["driver"],
            "template": {"spec": {"initContainers": [{"name": "init", "image": "i", "args": [LIDAR]}]}},
        },
    ],
    ids=["args", "command", "env", "init container"],
)
def test_a_path_that_no_node_hands_over_is_refused_wherever_it_is_written(fields: dict[str, Any]) -> None:
    (problem,) = list_problems(**fields)
    assert f"{LIDAR} would reach driver as this very text" in problem


@pytest.mark.parametrize("text", [f"${LIDAR}", "$(ROBOTAPP_DEVICES)", "$ROBOTAPP_DEVICE_LIDAR"])
def test_what_the_kubelet_would_not_replace_and_other_variables_are_accepted(text: str) -> None:
    assert list_problems(args=["driver", text]) == []


@pytest.mark.parametrize(
    "words",
    [
        {"args": ["ros2", "launch", "bringup", "robot.launch.py"]},
        {"command": ["/ros_entrypoint.sh"], "args": ["ros2", "launch", "bringup", "robot.launch.py"]},
    ],
)
def test_parameter_files_of_a_launch_file_are_refused_with_the_argument_that_takes_them(words: dict[str, Any]) -> None:
    (problem,) = list_problems(parameters=INLINE, **words)
    assert 'params:="$ROBOTAPP_PARAMETER_FILES"' in problem


@pytest.mark.parametrize(
    "args",
    [
        ["ros2", "run", "package", "launch"],
        ["bash", "-c", 'ros2 launch p f params:="$ROBOTAPP_PARAMETER_FILES"'],
        ["my-launch"],
    ],
)
def test_parameter_files_reach_what_is_no_launch_file(args: list[str]) -> None:
    assert list_problems(parameters=INLINE, args=args) == []


def test_a_ros_tool_as_command_is_told_that_the_entry_point_is_passed_by() -> None:
    (note,) = (note for note in list_notes(command=["ros2", "run", "p", "n"]) if ".command" in note)
    assert "write these words under args" in note
    assert not [note for note in list_notes(args=["ros2", "run", "p", "n"]) if "entry point" in note]


@pytest.mark.parametrize(
    ("device", "cure"),
    [
        ({"type": "camera"}, "write video"),
        ({"type": "tty"}, "write serial"),
        ({"type": "lidar"}, "or add the rule"),
        ({"type": "usb"}, "write its usbID or model"),
        ({"type": "serial", "interface": "ttyUSB0"}, "VID:PID:SERIAL"),
        ({"type": "serial", "interface": "/dev/ttyACM1"}, "VID:PID:SERIAL"),
        ({"type": "serial", "interface": "dev-ttyUSB0"}, "VID:PID:SERIAL"),
        ({"type": "video", "model": "Intel RealSense"}, "write Intel"),
    ],
)
def test_a_device_that_no_agent_publishes_is_told_with_what_to_write(device: dict[str, str], cure: str) -> None:
    (note,) = (note for note in list_notes(args=["x"], devices=[{"name": "d", **device}]) if ".devices[0]" in note)
    assert cure in note


@pytest.mark.parametrize(
    "device",
    [
        {"type": "video"},
        {"type": "usb", "usbID": "1a86:7523"},
        {"type": "can", "interface": "can0"},
        {"type": "gripper"},
    ],
)
def test_a_device_that_an_agent_or_a_rule_of_it_publishes_is_accepted_in_silence(device: dict[str, str]) -> None:
    assert not [note for note in list_notes(args=["x"], devices=[{"name": "d", **device}]) if ".devices[0]" in note]


INIT = {"name": "init", "image": "i"}


@pytest.mark.parametrize(
    "fields",
    [
        {"lifecycle": {"stopSignal": "SIGINT"}},
        {"template": {"spec": {"initContainers": [INIT | {"lifecycle": {"stopSignal": "SIGINT"}}]}}},
    ],
    ids=["main", "init container"],
)
def test_a_stop_signal_is_refused_with_the_hook_that_does_the_same(fields: dict[str, Any]) -> None:
    (problem,) = list_problems(**fields)
    assert "kill -INT 1" in problem


def test_an_unmasked_proc_is_refused_because_the_pods_have_no_user_namespace() -> None:
    (problem,) = list_problems(securityContext={"procMount": "Unmasked"})
    assert "leave it out" in problem
    assert list_problems(securityContext={"procMount": "Default"}) == []


def test_fields_that_older_clusters_drop_are_told_with_the_release_that_has_them() -> None:
    variable = {"name": "A", "valueFrom": {"fileKeyRef": {"volumeName": "v", "path": "p", "key": "k"}}}
    rules = [{"action": "Restart", "exitCodes": {"operator": "In", "values": [1]}}]
    init = INIT | {"restartPolicy": "Always", "restartPolicyRules": rules}
    notes = [
        note for note in list_notes(env=[variable], template={"spec": {"initContainers": [init]}}) if "1.35" in note
    ]
    assert [note.partition(":")[0] for note in notes] == [
        "spec.components[0].env[0].valueFrom.fileKeyRef",
        "spec.components[0].template.spec.initContainers[0].restartPolicyRules",
    ]


NAME = "tokens-$(ROS_DOMAIN_ID)"


@pytest.mark.parametrize(
    ("fields", "path"),
    [
        ({"envFrom": [{"secretRef": {"name": NAME}}]}, "envFrom[0].secretRef.name"),
        (
            {"env": [{"name": "A", "valueFrom": {"secretKeyRef": {"name": NAME, "key": "k"}}}]},
            "env[0].valueFrom.secretKeyRef.name",
        ),
        (
            {"template": {"spec": {"volumes": [{"name": "v", "secret": {"secretName": NAME}}]}}},
            "volumes[0].secret.secretName",
        ),
        (
            {
                "template": {
                    "spec": {"volumes": [{"name": "v", "projected": {"sources": [{"configMap": {"name": NAME}}]}}]}
                }
            },
            "volumes[0].projected.sources[0].configMap.name",
        ),
        (
            {"template": {"spec": {"volumes": [{"name": "v", "persistentVolumeClaim": {"claimName": NAME}}]}}},
            "volumes[0].persistentVolumeClaim.claimName",
        ),
        ({"template": {"spec": {"imagePullSecrets": [{"name": NAME}]}}}, "imagePullSecrets[0].name"),
    ],
    ids=["envFrom", "env", "secret", "projected", "claim", "pull secret"],
)
def test_a_reference_that_is_not_expanded_in_the_name_of_an_object_is_refused(
    fields: dict[str, Any], path: str
) -> None:
    (problem,) = list_problems(**fields)
    assert f".{path}: $(ROS_DOMAIN_ID) in {NAME} is taken as it stands" in problem
    of_robot = json.loads(json.dumps(fields).replace("ROS_DOMAIN_ID", "ROBOTAPP_ROBOT"))
    (problem,) = list_problems(**of_robot)
    assert "names the robot, but the app has none; write spec.robots" in problem
    robots = {"nodeSelector": {"matchLabels": {"robotics.io/robot": "amr-07"}}}
    assert list(spec_problems(make_app(component(**of_robot), robots=robots).spec)) == []


def test_a_reference_in_a_value_is_accepted() -> None:
    assert list_problems(env=[{"name": "A", "value": "$(ROBOTAPP_ROBOT)"}]) == []
