"""What a component starts and what it calls its devices, as far as the words alone tell that it will not work."""

import json
from typing import Any, Final

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
        {"run": {"package": "p", "executable": "driver", "args": ["--port", LIDAR]}},
        {"launch": {"package": "p", "file": "f", "arguments": {"port": LIDAR}}},
    ],
    ids=["args", "command", "env", "init container", "run", "launch"],
)
def test_a_path_that_is_not_fixed_before_the_start_is_refused_wherever_it_is_written(fields: dict[str, Any]) -> None:
    lidar = {"name": "lidar", "type": "serial"}
    (problem,) = list_problems(devices=[lidar], **fields)
    assert f"{LIDAR} is not replaced" in problem
    assert "write spec.components[0].devices[0].mountAs: /dev/lidar" in problem
    assert list_problems(devices=[lidar | {"mountAs": "/dev/front"}], **fields) == []
    (problem,) = list_problems(devices=[{"name": "base", "type": "serial", "mountAs": "/dev/base"}], **fields)
    assert f"{LIDAR} is the path of no device of driver, whose devices are base" in problem


@pytest.mark.parametrize(
    ("device", "cure"),
    [
        ({"name": "lidar", "type": "serial", "count": 2}, "write a device of its own with mountAs for each"),
        ({"name": "lidar", "type": "can", "interface": "can1"}, "write its name, such as can1"),
    ],
)
def test_a_reference_to_several_devices_or_to_a_bus_is_refused_with_a_cure_of_its_own(
    device: dict[str, Any], cure: str
) -> None:
    (problem,) = list_problems(args=[LIDAR], devices=[device])
    assert cure in problem


@pytest.mark.parametrize(
    ("kind", "says"), [("can", "a CAN bus is a network interface"), ("gpu", "device plugin decides")]
)
def test_what_has_no_path_of_its_own_is_mounted_nowhere(kind: str, says: str) -> None:
    (problem,) = list_problems(devices=[{"name": "bus", "type": kind, "mountAs": "/dev/bus"}])
    assert says in problem


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
    assert "write launch: {package: PACKAGE, file: FILE, parametersArgument: params_file}" in problem
    assert "params_file:=$(ROBOTAPP_PARAMS)" in problem


@pytest.mark.parametrize(
    "args",
    [
        ["ros2", "run", "package", "launch"],
        ["bash", "-c", 'ros2 launch p f params:="$ROBOTAPP_PARAMETER_FILES"'],
        ["bash", "-c", 'ros2 launch p f params:="$ROBOTAPP_PARAMS"'],
        ["ros2", "launch", "p", "f", "params:=$(ROBOTAPP_PARAMS)"],
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
        ({"type": "lidar"}, "or add the rule"),
        ({"type": "serial", "interface": "ttyUSB0"}, "VID:PID:SERIAL"),
        ({"type": "serial", "interface": "/dev/ttyACM1"}, "VID:PID:SERIAL"),
        ({"type": "serial", "interface": "dev-ttyUSB0"}, "VID:PID:SERIAL"),
        ({"type": "video", "model": "***"}, "leave it out"),
    ],
)
def test_a_device_that_no_agent_publishes_is_told_with_what_to_write(device: dict[str, str], cure: str) -> None:
    (note,) = (note for note in list_notes(args=["x"], devices=[{"name": "d", **device}]) if ".devices[0]" in note)
    assert cure in note


@pytest.mark.parametrize(
    "device",
    [
        {"type": "video"},
        {"type": "camera"},
        {"type": "tty"},
        {"type": "video", "model": "Intel(R) RealSense 435i"},
        {"type": "serial", "interface": "/dev/ttyTHS1"},
        {"type": "serial", "usbID": "0x10c4:0xea60"},
        {"type": "usb", "usbID": "1a86:7523"},
        {"type": "can", "interface": "can0"},
        {"type": "gripper"},
    ],
)
def test_a_device_that_an_agent_or_a_rule_of_it_publishes_is_accepted_in_silence(device: dict[str, str]) -> None:
    assert not [note for note in list_notes(args=["x"], devices=[{"name": "d", **device}]) if ".devices[0]" in note]


def test_any_usb_device_is_claimed_by_nobody() -> None:
    (problem,) = list_problems(args=["x"], devices=[{"name": "d", "type": "usb"}])
    assert "usb alone is any USB device of the node; write its usbID or model" in problem
    assert list_problems(args=["x"], requires=[{"type": "usb"}]) == []


def test_no_device_is_mounted_below_another_one() -> None:
    devices = [
        {"name": name, "type": "serial", "mountAs": path}
        for name, path in {"arm": "/dev/arm", "j": "/dev/arm/j"}.items()
    ]
    (problem,) = list_problems(args=["x"], devices=devices)
    assert "devices[1].mountAs" in problem
    assert "/dev/arm/j lies below /dev/arm, which is the device arm and no folder; write another path" in problem
    assert list_problems(args=["x"], devices=[{**devices[0], "mountAs": "/dev/a"}, devices[1]]) == []


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
    assert "[sh, -c, 'kill -INT 1; sleep 10']}}" in problem


@pytest.mark.parametrize("field", ["hostPID", "shareProcessNamespace"])
def test_the_hook_in_place_of_a_stop_signal_does_not_end_the_first_process_of_pod_or_node(field: str) -> None:
    (problem, *_) = list_problems(lifecycle={"stopSignal": "SIGINT"}, template={"spec": {field: True}})
    assert "kill -INT 1" not in problem
    assert "pkill -INT -f PROGRAM" in problem


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


@pytest.mark.parametrize(
    "image", ["ros:humble", "osrf/ros:noetic-desktop", "docker.io/library/ros:jazzy", "reg:5000/ros"]
)
def test_an_image_of_ros_alone_starts_nothing_and_a_note_says_so(image: str) -> None:
    assert any("starts a shell by itself, which ends at once" in note for note in list_notes(image=image))
    assert not list_notes(image=image, args=["ros2", "run", "a", "b"])
    assert not list_notes(image=image.replace("ros", "team/robot", 1) if "osrf" not in image else "osrf/gazebo:1")


def test_a_gpu_among_devices_is_told_where_it_comes_from() -> None:
    (note,) = [note for note in list_notes(devices=[{"name": "g", "type": "gpu"}]) if "devices" in note]
    assert "no claim is made for a gpu" in note
    assert not [note for note in list_notes(requires=[{"type": "gpu"}]) if "no claim" in note]


RUN: Final = {"run": {"package": "p", "executable": "e"}}
LAUNCH: Final = {"package": "p", "file": "f.launch.py"}
NOETIC: Final = {"ros": {"distro": "noetic"}}


def list_app_problems(*components: dict[str, Any], **spec: Any) -> list[str]:
    return [str(problem) for problem in spec_problems(make_app(*components, **spec).spec)]


@pytest.mark.parametrize(
    "fields",
    [
        {**RUN, "parameters": INLINE * 2},
        {"launch": {**LAUNCH, "parametersArgument": "params_file"}, "parameters": INLINE},
        {
            "launch": {**LAUNCH, "arguments": {"map_params": "/etc/robotapp/parameters/1.yaml"}},
            "parameters": INLINE * 2,
        },
        {"launch": LAUNCH},
        {"ros": "None", "parameters": [{"inline": "listener 1883"}], "args": ["mosquitto"]},
        {"ros": "None", "parameters": [{"inline": "a: b: c"}]},
    ],
    ids=["run", "launch", "launch with paths", "no parameters", "no ROS", "no ROS and no arguments"],
)
def test_parameter_files_have_a_way_to_the_program(fields: dict[str, Any]) -> None:
    assert list_problems(**fields) == []


@pytest.mark.parametrize(
    ("launch", "files", "cure"),
    [
        (LAUNCH, 1, "write launch.parametersArgument with the name of its argument that takes the path"),
        ({**LAUNCH, "parametersArgument": "params_file"}, 0, "driver has none; write parameters, or remove it"),
        (
            {**LAUNCH, "parametersArgument": "params_file"},
            2,
            "write launch.arguments with a path for each, /etc/robotapp/parameters/0.yaml",
        ),
    ],
    ids=["no argument", "no file", "two files"],
)
def test_parameter_files_that_do_not_reach_a_launch_file_are_refused(
    launch: dict[str, Any], files: int, cure: str
) -> None:
    (problem,) = list_problems(launch=launch, parameters=INLINE * files)
    assert cure in problem


def test_parameters_of_ros1_need_the_name_under_which_they_are_loaded() -> None:
    file = [{"inline": "rate: 20.0"}]
    named = {"run": {**RUN["run"], "name": "front"}}
    assert list_app_problems(component(**named, parameters=file), **NOETIC) == []
    (problem,) = list_app_problems(component(**RUN, parameters=file), **NOETIC)
    assert "write run.name" in problem
    (problem,) = list_app_problems(component(args=["rosrun", "p", "e"], parameters=file), **NOETIC)
    assert (
        "write run with a name, launch with parametersArgument, or a script that loads $ROBOTAPP_PARAMS with rosparam"
        in problem
    )
    script = "rosparam load $ROBOTAPP_PARAMS /front; exec rosrun p e __name:=front"
    assert list_app_problems(component(args=["bash", "-c", script], parameters=file), **NOETIC) == []


def test_an_inline_file_of_ros1_is_a_mapping() -> None:
    named = {"run": {**RUN["run"], "name": "front"}}
    (problem,) = list_app_problems(component(**named, parameters=[{"inline": "[1, 2]"}]), **NOETIC)
    assert "must be a mapping of parameters" in problem


@pytest.mark.parametrize("reference", ["$(ROBOTAPP_ROBOT)", "$(ROBOTAPP_INSTANCE)"])
def test_the_name_of_a_robot_needs_robots(reference: str) -> None:
    run = {"package": "p", "executable": "e", "args": [f"--name={reference}"]}
    (problem,) = list_problems(run=run)
    assert f"{reference} is the name of a robot, but the app has none; write spec.robots" in problem
    assert list_problems(run={**run, "args": [f"--name=${reference}"]}) == []
    robots = {"nodeSelector": {"matchLabels": {"robotics.io/tier": "robot"}}}
    assert list_app_problems(component(run=run), robots=robots) == []


@pytest.mark.parametrize(
    ("fields", "field"),
    [
        (RUN, "run"),
        ({"launch": LAUNCH}, "launch"),
        ({"ready": {"lifecycle": "Active"}}, "ready"),
        ({"env": [{"name": "ROS_MASTER_URI", "value": "http://m:11311"}]}, "env"),
    ],
)
def test_what_is_for_ros_is_refused_in_an_app_without_ros(fields: dict[str, Any], field: str) -> None:
    (problem,) = list_app_problems(component(**fields), ros={"distro": "none"})
    assert problem.startswith(f"spec.components[0].{field}: ")


def test_settings_of_ros_are_refused_in_an_app_without_ros_and_noted_where_no_component_uses_it() -> None:
    assert list_app_problems(component(), ros={"distro": "none"}) == []
    (problem,) = list_app_problems(component(), ros={"distro": "none"}, ros2={"pool": "default"})
    assert problem == "spec.ros2: an app with ros.distro: none has no ROS; remove it, or write the distribution"
    whole = make_app(component(ros="None"), ros2={"pool": "default"})
    assert "spec.ros2: has no effect: no component uses ROS (ros: None), so the app takes no domain" in map(
        str, spec_notes(whole.spec)
    )


def test_edges_to_components_without_ros_are_no_topics_that_localhost_keeps_apart() -> None:
    whole = {"ros2": {"discovery": {"mode": "Localhost"}}, "edges": [{"topic": "/sql", "from": "a", "to": "store"}]}
    assert list_app_problems(component("a"), component("store", ros="None"), **whole) == []
    assert len(list_app_problems(component("a"), component("store"), **whole)) == 1


def list_replica_notes(**fields: Any) -> list[str]:
    whole = {"ros": {"distro": fields.pop("distro", "jazzy")}}
    spec = make_app(component(**{"replicas": 3} | fields), **whole).spec
    return [note.message for note in spec_notes(spec) if note.field == "spec.components[0].replicas"]


def env_of_pod(field: str) -> list[dict[str, Any]]:
    return [{"name": "SELF", "valueFrom": {"fieldRef": {"fieldPath": field}}}]


@pytest.mark.parametrize(
    "fields",
    [
        {"args": ["ros2", "run", "a", "b"]},
        {"launch": LAUNCH},
        {"args": ["ros2", "run", "a", "b"], "env": env_of_pod("spec.nodeName")},
        {"args": ["ros2", "run", "a", "b"], "env": [{"name": "SELF", "value": "metadata.name"}]},
        {"args": ["ros2", "run", "a", "b"], "env": env_of_pod("metadata.namespace"), "replicas": 2},
    ],
)
def test_copies_of_a_ros_program_with_one_node_name_are_noted_with_what_to_write(fields: dict[str, Any]) -> None:
    (message,) = list_replica_notes(**fields)
    assert message.startswith(f"all {fields.get('replicas', 3)} copies have the node name of their program")
    assert "reach any of them; write replicaIdentity: Ordinal, or make the name from the pod's" in message


def test_a_name_that_run_gives_to_all_copies_is_noted_even_beside_the_name_of_the_pod() -> None:
    (message,) = list_replica_notes(
        run={"package": "a", "executable": "b", "name": "eye"}, env=env_of_pod("metadata.name")
    )
    assert message.startswith("all 3 copies have the name eye of run.name; ")


def test_in_ros_1_the_master_ends_all_copies_but_one() -> None:
    (message,) = list_replica_notes(distro="noetic", args=["rosrun", "a", "b"])
    assert "the master ends the earlier of two nodes of one name" in message


@pytest.mark.parametrize(
    "fields",
    [
        {"replicas": 1},
        {"replicas": 0},
        {"ros": "None"},
        {"distro": "none"},
        {"env": env_of_pod("metadata.name")},
        {"env": env_of_pod("metadata.uid")},
    ],
)
def test_one_copy_programs_without_ros_and_names_made_of_the_pods_are_not_noted(fields: dict[str, Any]) -> None:
    assert list_replica_notes(args=["program"], **fields) == []


def test_a_pod_has_at_most_as_many_devices_as_one_claim_can_hold() -> None:
    devices: list[dict[str, Any]] = [{"name": f"d{index}", "type": "video", "count": 11} for index in range(3)]
    (problem,) = list_problems(args=["x"], devices=devices)
    assert "33 exclusive devices are more than one pod can have handed over, which are 32" in problem
    assert list_problems(args=["x"], devices=[*devices[:2], devices[2] | {"count": 10}]) == []
    assert list_problems(args=["x"], devices=[*devices[:2], devices[2] | {"sharing": "Cluster"}]) == []
