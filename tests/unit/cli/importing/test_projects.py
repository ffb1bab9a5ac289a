"""Several files and several services: anchors, extends, include, profiles, variables, names."""

import pytest
from tests.unit.cli.importing.compose import (
    find_lines,
    get_component,
    get_spec,
    get_verdict,
    import_files,
    import_services,
)

from robotapp_cli.importing.report import ComposeError, Verdict


def test_anchors_and_merge_keys() -> None:
    text = """
x-common: &common
  image: ros:jazzy
  environment: &env {A: a}
services:
  nav:
    <<: *common
    environment: {<<: *env, B: b}
"""
    result = import_files({"compose.yaml": text})
    assert [entry["name"] for entry in get_component(result, "nav")["env"]] == ["B", "A"]
    assert get_verdict(result, "x-common") is Verdict.LEFT_OUT


def test_extends_in_the_same_file_and_in_another_one() -> None:
    files = {
        "robot/compose.yaml": """
services:
  base: {image: "ros:jazzy", environment: [A=1, B=1], cap_add: [SYS_NICE], profiles: [never]}
  nav:
    extends: base
    environment: {B: 2}
    cap_add: [NET_RAW]
  lidar:
    extends: {service: lidar, file: ../common/base.yaml}
    command: mine
""",
        "common/base.yaml": """
services:
  lidar: {image: "ros:jazzy", command: theirs, volumes: ["./lidar.yaml:/lidar.yaml"]}
""",
        "common/lidar.yaml": "a: 1\n",
    }
    result = import_files(files)
    assert get_component(result, "nav")["env"] == [{"name": "A", "value": "1"}, {"name": "B", "value": "2"}]
    assert get_component(result, "nav")["securityContext"]["capabilities"]["add"] == ["SYS_NICE", "NET_RAW"]
    assert get_component(result, "lidar")["args"] == ["mine"]
    volume = get_component(result, "lidar")["template"]["spec"]["volumes"][0]
    assert volume["hostPath"] == {"path": "/srv/common/lidar.yaml"}


@pytest.mark.parametrize(
    ("services", "message"),
    [
        ("{a: {extends: b}, b: {extends: a}}", "extends itself"),
        ("{a: {extends: c}}", "has no service c"),
        ("{a: {extends: {service: a, file: none.yaml}}}", "cannot be read"),
        ("{a: {extends: {file: none.yaml}}}", "service to extend is missing"),
        ("{a: 5}", "a mapping is needed"),
        ("{}", "no service is left"),
        ("{a: {image: x, volumes: ['data:/data']}}", "no volume is called data"),
        ("{a: {image: x, image: y}}", "written twice"),
    ],
)
def test_what_cannot_be_imported_names_the_file_and_the_line(services: str, message: str) -> None:
    with pytest.raises(ComposeError, match=rf"^compose.yaml:1: .*{message}"):
        import_files({"compose.yaml": f"services: {services}\n"})


def test_included_files_have_their_own_folder_and_variables() -> None:
    files = {
        "compose.yaml": "include: [lidar/compose.yaml]\nservices: {nav: {image: 'ros:jazzy'}}\n",
        "lidar/compose.yaml": "services: {lidar: {image: 'lidar:$TAG', volumes: ['./c.yaml:/c.yaml']}}\n",
        "lidar/.env": "TAG=jazzy\n",
        "lidar/c.yaml": "x: 1\n",
    }
    result = import_files(files)
    assert get_component(result, "lidar")["image"] == "lidar:jazzy"
    assert result.objects[0]["data"] == {"c.yaml": "x: 1\n"}


def test_a_file_that_includes_itself_is_refused() -> None:
    with pytest.raises(ComposeError, match="include each other"):
        import_files({"compose.yaml": "include: [compose.yaml]\nservices: {a: {image: x}}\n"})


def test_later_files_are_merged_into_the_first() -> None:
    files = {
        "compose.yaml": "services: {nav: {image: 'ros:jazzy', command: a, ports: ['80:80']}}\n",
        "robot.yaml": "services: {nav: {command: b, ports: ['81:81']}, ui: {image: 'ros:jazzy'}}\n",
    }
    result = import_files(files, names=["compose.yaml", "robot.yaml"])
    assert get_component(result, "nav")["args"] == ["b"]
    assert [port["containerPort"] for port in get_component(result, "nav")["ports"]] == [80, 81]
    assert len(get_spec(result)["components"]) == 2


def test_profiles_choose_services() -> None:
    services = {"nav": {"image": "ros:jazzy"}, "sim": {"image": "ros:jazzy", "profiles": ["sim"]}}
    result = import_services(services)
    assert [component["name"] for component in get_spec(result)["components"]] == ["nav"]
    assert "--profile" in find_lines(result, "services.sim")[0][1]
    assert len(get_spec(import_services(services, profiles=frozenset({"sim"})))["components"]) == 2


def test_variables_come_from_the_env_file_beside_and_from_the_command_line() -> None:
    files = {"compose.yaml": "services: {a: {image: 'ros:$A-$B'}}\n", ".env": "A=jazzy\nB=base\n"}
    assert get_component(import_files(files, variables={"B": "core"}), "a")["image"] == "ros:jazzy-core"


def test_required_variables_without_a_value_are_marked_with_the_cure() -> None:
    services = {"a": {"image": "ros:jazzy", "devices": ["${PORT:?say}"], "environment": ["DISPLAY=${DISPLAY:?say}"]}}
    result = import_services(services)
    assert get_component(result, "a")["env"] == [{"name": "DISPLAY", "value": "CHOOSE-A-VALUE"}]
    assert "--env PORT=" in find_lines(result, "services.a.devices[0]")[0][1]
    assert get_verdict(result, "services.a.devices[0]") is Verdict.CHOOSE


def test_names_become_those_of_kubernetes() -> None:
    services = {"My_Nav": {"image": "ros:jazzy"}, "my-nav": {"image": "ros:jazzy", "depends_on": ["My_Nav"]}}
    result = import_services(services, top={"name": "The_Robot"})
    assert result.objects[-1]["metadata"]["name"] == "the-robot"
    assert [component["name"] for component in get_spec(result)["components"]] == ["my-nav", "my-nav-2"]
    assert get_component(result, "my-nav-2")["dependsOn"] == [{"component": "my-nav"}]
