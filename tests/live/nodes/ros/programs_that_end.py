"""Programs of real ROS 2 (rclpy) for apps whose work ends. The test gives this file to its pods by a ConfigMap.

python3 programs_that_end.py mapper        # publishes a grid
python3 programs_that_end.py save FOLDER   # writes the first grid that it hears, and ends
python3 programs_that_end.py run FOLDER    # a run of a sweep: writes its values and all that it heard on its topic, and ends
"""

import json
import os
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import rclpy
from nav_msgs.msg import OccupancyGrid
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""As map servers offer their map and map savers ask for it."""
WIDTH, HEIGHT, RESOLUTION_M = 20, 10, 0.05
PERIOD_S = 0.1
LISTENED_S = 2.0
"""Time for which a run listens, so that it would hear another one beside it."""


def main(role: str, folder: str = "") -> None:
    """Ends at SIGTERM by rclpy's own handler."""
    rclpy.init()
    with suppress(ExternalShutdownException):
        node = rclpy.create_node(role)
        if role == "mapper":
            publish_grid(node)
        elif role == "save":
            write_result(folder, take_grid(node))
        else:
            write_result(folder, listen(node))


def publish_grid(node: Node) -> None:
    """Publishes the same grid again and again, as a mapper does that finds nothing new."""
    grid = OccupancyGrid(data=[cell % 101 for cell in range(WIDTH * HEIGHT)])
    grid.info.width, grid.info.height, grid.info.resolution = WIDTH, HEIGHT, RESOLUTION_M
    publisher = node.create_publisher(OccupancyGrid, "/map", LATCHED)
    node.create_timer(PERIOD_S, lambda: publisher.publish(grid))
    rclpy.spin(node)


def take_grid(node: Node) -> dict[str, Any]:
    """Returns the first grid that comes."""
    grids: list[OccupancyGrid] = []
    node.create_subscription(OccupancyGrid, "/map", grids.append, LATCHED)
    while not grids:
        rclpy.spin_once(node)
    (grid, *_) = grids
    return {"width": grid.info.width, "height": grid.info.height, "cells": list(grid.data)}


def listen(node: Node) -> dict[str, Any]:
    """Publishes the values of this run for a while; returns them with all values that it heard."""
    values = {"speed": os.environ["MATRIX_SPEED"], "seed": os.environ["MATRIX_SEED"]}
    said = String(data=json.dumps(values))
    heard: set[str] = set()
    node.create_subscription(String, "/values", lambda message: heard.add(message.data), 10)
    publisher = node.create_publisher(String, "/values", 10)
    node.create_timer(PERIOD_S, lambda: publisher.publish(said))
    end_s = time.monotonic() + LISTENED_S
    while time.monotonic() < end_s or not heard:
        rclpy.spin_once(node, timeout_sec=PERIOD_S)
    return {**values, "domain": int(os.environ["ROS_DOMAIN_ID"]), "heard": [json.loads(text) for text in heard]}


def write_result(folder: str, result: dict[str, Any]) -> None:
    """Writes the result as a file that must not be there yet: a second program in the same folder fails."""
    with (Path(folder) / "result.json").open("x") as file:
        json.dump(result, file)


if __name__ == "__main__":
    main(*sys.argv[1:])
