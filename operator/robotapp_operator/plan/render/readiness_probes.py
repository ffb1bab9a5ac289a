"""Readiness probes: the component's own, or one from `ready`, which asks ROS.

A ROS 2 probe starts one small observer in the component's container, with the image's own Python and rclpy, and then only reads
the line that the observer keeps. A query of its own each time would cost seconds and a new participant, and with a discovery
server it would learn nothing: only a super client is told topics and types that it does not use.
"""

import shlex
from typing import Any, Final

from robotapp_api.model.app.component import Component, ReadyTopic
from robotapp_api.values.quantities.quantity import parse_milli
from robotapp_operator.plan.spec.desired import App

PERIOD_S: Final = 2
TIMEOUT_S: Final = 5
ROS1_PERIOD_S: Final = 15
ROS1_TIMEOUT_S: Final = 10
_QUERY_TIMEOUT_S: Final = 7

OBSERVER: Final = """\
import collections, importlib, os, sys, time
import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
state, kind, name, type_name, rate = sys.argv[1:6]
rate = float(rate)
rclpy.init(args=[])
node = rclpy.create_node("_robotapp_ready_%d" % os.getpid(), enable_rosout=False, start_parameter_services=False)
times = collections.deque(maxlen=max(10, min(1000, int(2 * rate))))
subscription, kept, future, asked, answer = None, False, None, 0.0, ""
def load(text, part):
    package, cls = text.split("/")[0], text.split("/")[-1]
    return getattr(importlib.import_module(package + "." + part), cls)
def subscribe(publishers):
    global subscription, kept
    kept = all(each.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL for each in publishers)
    qos = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    if kept:
        qos = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    message = load(publishers[0].topic_type or type_name, "msg")
    subscription = node.create_subscription(message, name, lambda _: times.append(time.monotonic()), qos, raw=True)
def judge_topic(now):
    publishers = node.get_publishers_info_by_topic(name)
    if subscription is None and publishers:
        subscribe(publishers)
    if not publishers:
        return "no publisher of " + name
    if not times:
        return "no message on " + name
    gap = (times[-1] - times[0]) / (len(times) - 1) if len(times) > 1 else 3.0
    if kept and not rate:
        return "ready"
    if now - times[-1] > max(2.0, 3 / rate if rate else 3 * gap):
        return "no message on %s for %.1f s" % (name, now - times[-1])
    if rate and (len(times) < 2 or 1 / max(gap, 1e-6) < 0.95 * rate):
        return "%.3g messages per second on %s, wanted are %g" % (1 / gap if len(times) > 1 else 0, name, rate)
    return "ready"
def judge_lifecycle(now):
    global future, asked, answer
    if future is not None and future.done():
        answer, future = future.result().current_state.label, None
    if not client.service_is_ready():
        answer, future = "", None
        return "no lifecycle node " + name
    if future is None or now - asked > 3:
        if future is not None:
            client.remove_pending_request(future)
            answer = ""
        future, asked = client.call_async(request.Request()), now
    return "ready" if answer == "active" else "%s is %s" % (name, answer or "silent")
if kind == "lifecycle":
    request = load("lifecycle_msgs/GetState", "srv")
    client = node.create_client(request, name + "/get_state")
judge = judge_lifecycle if kind == "lifecycle" else judge_topic
written = 0.0
while True:
    rclpy.spin_once(node, timeout_sec=0.1)
    if time.monotonic() - written > 0.4:
        written = time.monotonic()
        with open(state + ".new", "w") as file:
            file.write(judge(written) + "\\n")
        os.replace(state + ".new", state)
"""
"""Keeps one line in a file: `ready`, or why not. A topic that keeps its last message counts as long as it has a publisher."""

# $1: the observer's program, $2: the file, the rest: the observer's arguments. Its environment is that of the container's first
# process, which the image's entry point has sourced. An observer that died is started again after 15 s.
_SCRIPT: Final = """\
program=$1; file=$2; shift 2; [ -w /tmp ] && file=/tmp/${file##*/}; now=$(date +%s)
if [ -f "$file" ] && [ $((now - $(stat -c %Y "$file"))) -le 3 ]; then read -r line <"$file"; echo "$line"; [ "$line" = ready ]; exit; fi
if [ -f "$file.log" ] && [ $((now - $(stat -c %Y "$file.pid"))) -le 15 ]; then tail -n 1 "$file.log"; echo starting; exit 1; fi
[ -f "$file.pid" ] && grep -qs "${file##*/}" "/proc/$(cat "$file.pid")/cmdline" && kill -9 "$(cat "$file.pid")"
@environment@python3 -c 'import sys, importlib.util as u; sys.exit(u.find_spec("rclpy") is None)' || . "/opt/ros/$ROS_DISTRO/setup.bash"
[ -w "${HOME:-/}" ] || export ROS_LOG_DIR=/dev/shm
export ROS_SUPER_CLIENT=TRUE
setsid python3 -c "$program" "$file" "$@" </dev/null >"$file.log" 2>&1 & echo $! >"$file.pid"
echo starting; exit 1
"""
_FIRST_ENVIRONMENT: Final = """\
[ -r /proc/1/environ ] && while IFS= read -r -d '' line; do export "$line"; done </proc/1/environ 2>/dev/null
"""
_PROBE: Final = _SCRIPT.replace("@environment@", _FIRST_ENVIRONMENT)
_PROBE_AMONG_OTHERS: Final = _SCRIPT.replace("@environment@", "")
"""For a container that sees other processes: the first one is the pause container's, or the node's."""


def readiness_probe(component: Component, app: App, *, node: str = "") -> dict[str, Any] | None:
    """The probe of the component's container, None when neither is written (running counts as ready).

    node: the full name that `run` gives its node, "" where it gives none.
    """
    ready = component.ready
    if ready is None:
        return component.readiness_probe.unpack() if component.readiness_probe is not None else None
    if app.ros_version == 1:
        return _query_ros1(ready.topic) if ready.topic else None
    if ready.topic:
        rate = parse_milli(ready.topic.min_rate) / 1000 if ready.topic.min_rate is not None else 0
        arguments = ["topic", ready.topic.name, _find_type(app, ready.topic.name), f"{rate:g}"]
    else:
        # Without a name of its own the node is named like its component, with underscores: ROS names have no dashes.
        arguments = ["lifecycle", node or f"/{component.name.replace('-', '_')}", "-", "0"]
    pod = component.template.spec
    # With the shared memory of the node the file is beside those of other apps.
    owner = f"{app.uid}-" if pod.host_ipc else ""
    state = f"/dev/shm/robotapp-ready-{owner}{component.name}"  # noqa: S108 - within the pod, where / may be read-only
    script = _PROBE_AMONG_OTHERS if pod.host_pid or pod.share_process_namespace else _PROBE
    return {
        "exec": {"command": ["bash", "-c", script, "robotapp-ready", OBSERVER, state, *arguments]},
        "periodSeconds": PERIOD_S,
        "timeoutSeconds": TIMEOUT_S,
        "failureThreshold": 1,
    }


def _find_type(app: App, topic: str) -> str:
    """Returns the type that an edge names for the topic, "-" for none."""
    return next(
        (edge.type for edge in app.spec.edges if edge.kind == "Topic" and edge.topic == topic and edge.type), "-"
    )


def _query_ros1(topic: ReadyTopic) -> dict[str, Any]:
    """Returns a probe that asks ROS 1's own tool, rarely: a query costs seconds."""
    name = shlex.quote(topic.name)
    command = f"timeout {_QUERY_TIMEOUT_S} rostopic echo -n 1 {name}"
    if topic.min_rate is not None:
        # `hz` runs until it is stopped and prints the average again and again; the last one counts.
        command = (
            f"timeout {_QUERY_TIMEOUT_S} rostopic hz -w 10 {name} | "
            f"awk '/average rate/ {{rate = $3}} END {{exit !(rate >= {parse_milli(topic.min_rate) / 1000:g})}}'"
        )
    return {
        "exec": {"command": ["bash", "-c", f'. "/opt/ros/$ROS_DISTRO/setup.bash" && {command}']},
        "periodSeconds": ROS1_PERIOD_S,
        "timeoutSeconds": ROS1_TIMEOUT_S,
    }
