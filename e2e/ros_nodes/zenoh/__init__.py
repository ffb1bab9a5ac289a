"""Programs that speak rmw_zenoh's wire format without ROS, by two libraries that share no code: pyzeros hears, zenoh-ros2-sdk talks.

rmw_zenoh_cpp is in no package index, so `stand_in` offers the few functions of rclpy that the operator's readiness probe calls.
"""

import setuptools  # noqa: F401 - first of all: it provides distutils, which a library of pyzeros imports and Debian's Python lacks
