"""Functions of rclpy that the operator's readiness probe calls, on pyzeros instead of rmw_zenoh_cpp.

The image offers this module as `rclpy` and `rclpy.qos`. Like rmw_zenoh_cpp it finds publishers by their liveliness tokens
(`@ros2_lv/<domain>/…/MP/…`) and receives messages under `<domain>/<topic>/<type>/<type hash>`.
"""

import importlib
import os
import queue
import threading
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from types import SimpleNamespace
from typing import Any, Final

import pyzeros
import pyzeros.sub
import zenoh

from ros_nodes.zenoh.sessions import open_session

_TYPE, _TOPIC, _QOS, _PARTS = 10, 9, 12, 13
"""Places in a publisher's token, and how many there are."""
_TRANSIENT_LOCAL: Final = "1"


class ReliabilityPolicy(Enum):
    RELIABLE = 1
    BEST_EFFORT = 2


class DurabilityPolicy(Enum):
    TRANSIENT_LOCAL = 1
    VOLATILE = 2


@dataclass(frozen=True)
class QoSProfile:
    """Quality of service of a subscription; Zenoh delivers without regard to it."""

    depth: int = 10
    reliability: ReliabilityPolicy = ReliabilityPolicy.RELIABLE
    durability: DurabilityPolicy = DurabilityPolicy.VOLATILE


class Node:
    """A node of the graph; its callbacks run in `spin_once`, as in rclpy."""

    def __init__(self, name: str) -> None:
        self.session = open_session("client")
        self._node = pyzeros.Session(node=name, zenoh_session=self.session)
        self._tokens: set[str] = set()
        self._lock = threading.Lock()
        publishers = f"@ros2_lv/{os.environ['ROS_DOMAIN_ID']}/*/*/*/MP/**"
        self._graph = self.session.liveliness().declare_subscriber(publishers, self._note_token, history=True)
        self.received: queue.SimpleQueue[tuple[Callable[[bytes], Any], bytes]] = queue.SimpleQueue()

    def _note_token(self, sample: zenoh.Sample) -> None:
        with self._lock:
            if sample.kind == zenoh.SampleKind.PUT:
                self._tokens.add(str(sample.key_expr))
            else:
                self._tokens.discard(str(sample.key_expr))

    def get_publishers_info_by_topic(self, topic: str) -> list[SimpleNamespace]:
        """Returns type and durability of the topic's publishers."""
        with self._lock:
            tokens = [token.split("/") for token in self._tokens]
        return [
            SimpleNamespace(
                topic_type=to_ros_type(parts[_TYPE]),
                qos_profile=SimpleNamespace(durability=read_durability(parts[_QOS])),
            )
            for parts in tokens
            if len(parts) == _PARTS and parts[_TOPIC].replace("%", "/") == topic
        ]

    def create_subscription(
        self, message: Any, topic: str, callback: Callable[[bytes], Any], _qos: Any, *, raw: bool = True
    ) -> Any:
        """Subscribes; the callback is given the serialized message, as with `raw` in rclpy."""
        assert raw
        return pyzeros.sub.RawSub(
            message,
            topic,
            lambda sample: self.received.put((callback, sample.payload.to_bytes())),
            session=self._node,
            scope=None,
        )


def init(args: Any = None) -> None:
    """Does nothing: every node has a session of its own."""


def create_node(name: str, **_options: Any) -> Node:
    return Node(name)


def spin_once(node: Node, *, timeout_sec: float) -> None:
    """Runs the callback of one message, which is waited for so long."""
    try:
        callback, data = node.received.get(timeout=timeout_sec)
    except queue.Empty:
        return
    callback(data)


def load_type(name: str) -> Any:
    """Returns the class of a message type by a name such as `std_msgs/msg/String`."""
    package, kind, cls = name.split("/")
    return getattr(importlib.import_module(f"ros2_pyterfaces.cydr.{package}.{kind}"), cls)


def to_ros_type(dds_type: str) -> str:
    """Returns `std_msgs/msg/String` for `std_msgs::msg::dds_::String_`."""
    package, kind, _, cls = dds_type.split("::")
    return f"{package}/{kind}/{cls.removesuffix('_')}"


def read_durability(qos: str) -> DurabilityPolicy:
    """Returns the durability of a token's quality of service, whose second field is empty for the default."""
    kept = qos.split(":")[1] == _TRANSIENT_LOCAL
    return DurabilityPolicy.TRANSIENT_LOCAL if kept else DurabilityPolicy.VOLATILE
