"""Reads the name of an image: its ROS distribution, or that no ROS is in it."""

import re
from typing import Final

from robotapp_api.model.distros import DISTROS

_WORDS: Final = re.compile(r"[a-z0-9]+")
_COMMON_WORDS: Final = frozenset(
    {"bouncy", "crystal", "diamondback", "electric", "fuerte", "groovy", "hydro", "iron", "jade", "lunar", "rolling"}
)
"""Distributions whose names are words of other things as well: they count in a tag beside a name with ros in it."""
# fmt: off
_WITHOUT_ROS: Final = frozenset({
    "adminer", "alertmanager", "caddy", "cadvisor", "chronograf", "coturn", "couchdb", "eclipse-mosquitto",
    "elasticsearch", "emqx", "grafana", "haproxy", "httpd", "husarnet", "influxdb", "kafka", "kibana", "loki",
    "mariadb", "mediamtx", "memcached", "minio", "mongo", "mongo-express", "mosquitto", "mysql", "nats",
    "neo4j", "nginx", "node-exporter", "node-red", "pgadmin4", "phpmyadmin", "portainer", "portainer-ce",
    "postgis", "postgres", "postgresql", "prometheus", "promtail", "rabbitmq", "redis", "rtsp-simple-server",
    "telegraf", "timescaledb", "traefik", "vault", "watchtower", "zookeeper",
})
# fmt: on
"""Last words of image names of databases, brokers, web servers and other programs that never have ROS in them."""


def find_distro(image: str) -> str:
    """Returns the ROS distribution that the name of an image has in it, "" without one.

    >>> find_distro("husarion/rplidar:humble-1.0.1"), find_distro("steel/iron:1")
    ('humble', '')
    """
    repository, _, tag = image.lower().partition("@")[0].rpartition(":")
    if not repository or "/" in tag:
        repository, tag = image.lower(), ""
    words = _WORDS.findall(tag) + _WORDS.findall(repository.rpartition("/")[2]) + _WORDS.findall(repository)
    has_ros = any(word.startswith("ros") or word.endswith(("ros", "ros2")) for word in _WORDS.findall(repository))
    for word in words:
        if word in DISTROS and (word not in _COMMON_WORDS or has_ros):
            return str(word)
    return ""


def find_distro_in(text: str) -> str:
    """Returns the distribution that a Dockerfile, command or path names beside the word ROS, "" without one.

    >>> find_distro_in("FROM ros:jazzy-ros-base"), find_distro_in("source /opt/ros/foxy/setup.bash")
    ('jazzy', 'foxy')
    """
    for line in text.lower().splitlines():
        image = re.match(r"\s*from\s+(?:--\S+\s+)?(\S+)", line)
        if image and (distro := find_distro(str(image[1]))):
            return distro
        match = re.search(r"(?:ros_distro\s*[=:]\s*[\"']?|/opt/ros/|\bros-)([a-z]+)", line)
        if match and match[1] in DISTROS:
            return str(match[1])
    return ""


def is_without_ros(image: str) -> bool:
    """Returns whether the image is a well-known one of a program that has no ROS in it."""
    repository = image.lower().partition("@")[0]
    name = repository.rpartition("/")[2].partition(":")[0]
    return name in _WITHOUT_ROS and not find_distro(image)
