"""Real ROS 1 programs started by `run` and `launch`, and programs that cannot be started, on a real kubelet."""

import json
import time
from collections.abc import Iterator
from typing import Any, Final

import pytest

from campaigns.nodes import teleop_app as teleop
from robotapp_testbed import images, wait_until
from robotapp_testbed.control_plane import product
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.machines.nodes import edge
from robotapp_testbed.real import RealNodes

pytestmark = pytest.mark.live

STARTED_S: Final = 90.0
NODE: Final = """\
#!/usr/bin/env python3
import json, sys, rospy
from std_msgs.msg import String
rospy.init_node("unnamed")
publisher = rospy.Publisher("said", String, queue_size=1, latch=True)
publisher.publish(json.dumps({"name": rospy.get_name(), "topic": publisher.resolved_name, "rate": rospy.get_param("~rate", None),
    "words": rospy.myargv(sys.argv)[1:]}))
rospy.spin()
"""
# Debian's rosrun needs a compiler to be installed; this one finds programs of the one package there is here.
ROSRUN: Final = '#!/bin/sh\npackage=$1; program=$2; shift 2; exec "/ws/$package/$program" "$@"\n'
LAUNCH: Final = """\
<launch>
  <arg name="side"/><arg name="params" default=""/>
  <group ns="$(arg side)">
    <node pkg="talk" type="node.py" name="launched" output="screen" required="true">
      <remap from="said" to="/launched/said"/>
      <rosparam command="load" file="$(arg params)"/>
    </node>
  </group>
</launch>
"""
FILES: Final = {
    "node.py": NODE,
    "rosrun": ROSRUN,
    "package.xml": "<package format='2'><name>talk</name></package>",
    "talk.launch": LAUNCH,
}
PLACES: Final = {
    "node.py": "/ws/talk/node.py",
    "package.xml": "/ws/talk/package.xml",
    "talk.launch": "/ws/talk/talk.launch",
}


@pytest.fixture(scope="module")
def cluster(real_machine: type[RealNodes]) -> Iterator[RealNodes]:
    with real_machine([edge("edge-1")], delays={}, images=("tools", "ros1"), kube_scheduler=True) as cp:
        product.install(cp)
        product.start_operator(cp)
        product.start_scheduler(cp)
        yield cp


@pytest.fixture
def place(cluster: RealNodes) -> Iterator[str]:
    with created(cluster, f"programs-{time.monotonic_ns() % 100_000}") as name:
        cluster.api.create(f"/api/v1/namespaces/{name}/configmaps", {"metadata": {"name": "talk"}, "data": FILES})
        yield name


def ros1_app(*components: dict[str, Any]) -> dict[str, Any]:
    """An app of the package `talk`, whose files come from a ConfigMap, in the image with Debian's ROS 1."""
    volume = {"name": "talk", "configMap": {"name": "talk", "defaultMode": 0o755}}
    mounts = [{"name": "talk", "mountPath": path, "subPath": file} for file, path in PLACES.items()]
    mounts.append({"name": "talk", "mountPath": "/usr/local/bin/rosrun", "subPath": "rosrun"})
    common = {
        "image": images.reference("ros1"),
        "imagePullPolicy": "IfNotPresent",
        "volumeMounts": mounts,
        "env": [{"name": "ROS_PACKAGE_PATH", "value": "/ws"}],
        "template": {"spec": {"volumes": [volume]}},
    }
    spec = {
        "ros": {"distro": "noetic"},
        "ros1": {"image": images.reference("ros1")},
        "components": [{**common, **component} for component in components],
    }
    return {"apiVersion": "robotics.io/v1alpha1", "kind": "RobotApp", "metadata": {"name": "talk"}, "spec": spec}


def said(cp: RealNodes, place: str, component: str, topic: str) -> dict[str, Any]:
    """What the node of a component published on its topic, read from another process of its pod."""
    script = (
        "import rospy, sys; from std_msgs.msg import String; rospy.init_node('listener', anonymous=True); "
        "print(rospy.wait_for_message(sys.argv[1], String, timeout=20).data)"
    )

    def answer() -> str:
        pod = teleop.pods(cp, place, "talk").get(component)
        if pod is None or pod["status"].get("phase") != "Running":
            return ""
        name = pod["metadata"]["name"]
        return cp.kubectl("exec", "-n", place, name, "--", "python3", "-c", script, topic, check=False).strip()

    assert wait_until(lambda: answer().startswith("{"), timeout_s=STARTED_S, poll_s=1.0), answer()
    found: dict[str, Any] = json.loads(answer())
    return found


def test_an_executable_and_a_launch_file_of_ros1_get_their_names_remaps_arguments_and_parameters(
    cluster: RealNodes, place: str
) -> None:
    app = ros1_app(
        {
            "name": "front",
            "run": {
                "package": "talk",
                "executable": "node.py",
                "name": "front",
                "namespace": "/head",
                "remaps": {"said": "/front/said"},
                "args": ["--fast", "two words"],
            },
            "parameters": [{"inline": "rate: 20.0"}],
        },
        {
            "name": "launched",
            "launch": {
                "package": "talk",
                "file": "talk.launch",
                "arguments": {"side": "left"},
                "parametersArgument": "params",
            },
            "parameters": [{"inline": "rate: 5.0"}],
        },
    )
    teleop.apply(cluster, place, [app])
    assert said(cluster, place, "front", "/front/said") == {
        "name": "/head/front",
        "topic": "/front/said",
        "rate": 20.0,
        "words": ["--fast", "two words"],
    }
    launched = said(cluster, place, "launched", "/launched/said")
    assert (launched["name"], launched["topic"], launched["rate"]) == ("/left/launched", "/launched/said", 5.0)


def test_a_program_that_the_image_does_not_have_is_named_in_the_status(cluster: RealNodes, place: str) -> None:
    component = {"name": "driver", "image": images.reference("tools"), "command": ["ros2", "run", "p", "n"]}
    spec = {"ros": {"distro": "none"}, "components": [component]}
    app = {"apiVersion": "robotics.io/v1alpha1", "kind": "RobotApp", "metadata": {"name": "talk"}, "spec": spec}
    teleop.apply(cluster, place, [app])
    path = f"/apis/robotics.io/v1alpha1/namespaces/{place}/robotapps/talk"

    def message() -> str:
        conditions = cluster.api.get(path).get("status", {}).get("conditions", ())
        return next((str(item["message"]) for item in conditions if item["type"] == "Ready"), "")

    wanted = 'driver: driver cannot be started: exec: "ros2": executable file not found in $PATH'
    assert wait_until(lambda: wanted in message(), timeout_s=STARTED_S, poll_s=0.5), message()
    restarted = wait_until(
        lambda: teleop.pods(cluster, place, "talk")["driver"]["status"]["containerStatuses"][0]["restartCount"] > 1,
        timeout_s=STARTED_S,
        poll_s=1.0,
    )
    assert restarted
    assert wanted in message(), "the reason stays while the kubelet waits between two tries"
