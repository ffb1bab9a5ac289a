"""The ROS side: finds the topics of the graph, and writes what is published on them as it was serialized."""

import importlib
import os
import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from robotapp_recorder.definitions import write_definition
from robotapp_recorder.store import BagStore, Channel
from robotapp_recorder.topics import Offer, Selection, Wanted, choose_subscriptions, describe_qos

DEPTH: Final = 100
LOOK_S: Final = 1.0
"""How often the graph is asked for new topics."""


def record(selection: Selection, store: BagStore) -> None:
    """Records until SIGTERM, and closes the open bag then."""
    # Clients of a discovery server are told only of the topics that they use.
    os.environ.setdefault("ROS_SUPER_CLIENT", "TRUE")
    rclpy.init(args=[])
    try:
        with suppress(ExternalShutdownException):
            Recorder(selection, store).run()
        store.close()
    finally:
        store.abandon()


class Recorder:
    """One node with a subscription for each recorded topic."""

    def __init__(self, selection: Selection, store: BagStore) -> None:
        self._selection = selection
        self._store = store
        self._node = rclpy.create_node(
            f"_robotapp_recorder_{os.getpid()}", enable_rosout=False, start_parameter_services=False
        )
        self._subscriptions: dict[str, Any] = {}
        self._problems: set[str] = set()

    def run(self) -> None:
        """Spins until rclpy is shut down."""
        looked_s = 0.0
        while rclpy.ok():
            rclpy.spin_once(self._node, timeout_sec=0.2)
            if time.monotonic() - looked_s >= LOOK_S:
                looked_s = time.monotonic()
                self._look()
                self._store.pass_time()

    def _look(self) -> None:
        subscriptions, problems = choose_subscriptions(self._selection, self._read_offers(), self._subscriptions)
        for line in problems:
            self._tell_once(line)
        for subscription in subscriptions:
            self._subscribe(subscription)

    def _read_offers(self) -> dict[str, list[Offer]]:
        """Returns the publishers of the wanted topics."""
        topics = (topic for topic, _ in self._node.get_topic_names_and_types() if self._selection.wants(topic))
        return {
            topic: [
                Offer(
                    publisher.topic_type,
                    publisher.qos_profile.reliability == ReliabilityPolicy.RELIABLE,
                    publisher.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL,
                )
                for publisher in self._node.get_publishers_info_by_topic(topic)
            ]
            for topic in topics
        }

    def _subscribe(self, wanted: Wanted) -> None:
        try:
            message = load_message(wanted.type_name)
        except (ImportError, AttributeError) as error:
            self._tell_once(
                f"{wanted.topic} is not recorded: this image has no {wanted.type_name} ({error}); "
                "write an image with that package into the recording"
            )
            return
        definition = write_definition(wanted.type_name, read_installed)
        qos = describe_qos(wanted, depth=DEPTH)
        self._store.add_channel(Channel(wanted.topic, wanted.type_name, definition, qos))
        profile = QoSProfile(
            depth=DEPTH,
            reliability=ReliabilityPolicy.RELIABLE if wanted.reliable else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if wanted.transient_local else DurabilityPolicy.VOLATILE,
        )

        def write(data: bytes, info: Mapping[str, Any]) -> None:
            self._store.add_message(wanted.topic, bytes(data), published_ns=int(info["source_timestamp"]))

        self._subscriptions[wanted.topic] = self._node.create_subscription(
            message, wanted.topic, write, profile, raw=True
        )
        tell(f"recording {wanted.topic} ({wanted.type_name})")

    def _tell_once(self, line: str) -> None:
        if line not in self._problems:
            self._problems.add(line)
            tell(line)


def tell(line: str) -> None:
    """Writes a line into the log of the pod."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def load_message(type_name: str) -> Any:
    """Returns the class of a message type. Raises ImportError or AttributeError where the image has none."""
    package, kind, name = type_name.split("/")
    return getattr(importlib.import_module(f"{package}.{kind}"), name)


def read_installed(package: str, name: str) -> str | None:
    """Returns the definition of a message from the packages of the image."""
    for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
        path = Path(prefix) / "share" / package / "msg" / f"{name}.msg"
        if prefix and path.is_file():
            return path.read_text(encoding="utf-8")
    return None
