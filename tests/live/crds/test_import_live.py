"""The output of `kubectl robotapp import` is taken by kubectl and the real API server as it is."""

import pytest
import yaml

from robotapp_cli.importing.app import import_compose
from robotapp_cli.importing.files.project import ImportRequest
from robotapp_cli.importing.writing import format_objects
from robotapp_testbed import ControlPlane

pytestmark = pytest.mark.live

COMPOSE = """\
name: everything
services:
  lidar:
    image: ros:jazzy
    entrypoint: [/entry.sh, "$$(HOST) y"]
    command: ros2 launch sllidar a2.launch.py port:=/dev/ttyUSB0
    environment: {ROS_DOMAIN_ID: 7, RMW_IMPLEMENTATION: rmw_cyclonedds_cpp, LETTER: "y", EMPTY: "", NUMBER: 0755}
    devices: [/dev/ttyUSB0, "/dev/dri:/dev/dri"]
    volumes: ["maps:/maps:ro", "./nav.yaml:/nav.yaml", "/dev:/dev", /cache, {type: tmpfs, target: /t, tmpfs: {size: 64m}}]
    tmpfs: /run:size=1m
    network_mode: host
    ipc: host
    pid: host
    privileged: true
    cap_add: [SYS_NICE]
    cap_drop: [ALL]
    security_opt: ["seccomp:unconfined", "apparmor:unconfined"]
    user: "0:0"
    group_add: ["20"]
    stop_signal: SIGINT
    configs: [nav]
    secrets: [key]
    labels: {team: nav, "traefik.rule": Host(`x`)}
    deploy: {resources: {limits: {cpus: "0.5", memory: 512M}, reservations: {devices: [{capabilities: [gpu], count: 1}]}}}
    tty: true
    stdin_open: true
  db:
    image: postgres:16
    ports: ["15432:5432", "6000-6002:6000-6002/udp"]
    expose: ["5432"]
    shm_size: 1gb
    read_only: true
    hostname: Data_Base
    platform: linux/arm64/v8
    pull_policy: always
    working_dir: /srv
    healthcheck: {test: pg_isready, interval: 1m30s, timeout: 5s, retries: 3}
    sysctls: {net.core.somaxconn: 1024}
    extra_hosts: ["lidar:10.0.0.5", "v6=::1"]
    dns: 10.0.0.2
    dns_search: [robots.example]
    dns_opt: ["ndots:2", use-vc]
  ui:
    image: example/ui:jazzy
    depends_on: {db: {condition: service_healthy}}
    scale: 2
volumes: {maps: {}}
configs: {nav: {content: "a: 1\\n"}}
secrets: {key: {external: true}}
"""


def test_every_field_that_the_import_writes_is_one_of_the_server(control_plane: ControlPlane) -> None:
    files = {"compose.yaml": COMPOSE.encode(), "nav.yaml": b"text: |\n  y\n"}
    result = import_compose(ImportRequest(["compose.yaml"], directory="/srv/robot"), files.get)
    text = format_objects(result.objects)
    answer = control_plane.kubectl(
        "create", "--dry-run=server", "--validate=strict", "-o", "yaml", "-f", "-", stdin=text
    )
    stored = {item["kind"]: item for item in yaml.safe_load_all(answer)}
    assert sorted(stored) == ["ConfigMap", "PersistentVolumeClaim", "RobotApp"]
    env = stored["RobotApp"]["spec"]["components"][0]["env"]
    assert [entry.get("value", "") for entry in env] == ["y", "", "493"]
