"""Fields of one service, in each of their forms."""

from typing import Any

import pytest
from tests.unit.cli.importing.compose import (
    find_lines,
    get_component,
    get_pod,
    get_verdict,
    import_files,
    import_one,
    import_services,
)

from robotapp_cli.importing.report import ComposeError, Verdict
from robotapp_cli.importing.writing import format_objects


@pytest.mark.parametrize("command", ["ros2 launch pkg 'my file.py'", ["ros2", "launch", "pkg", "my file.py"]])
def test_command_is_args_and_entrypoint_is_command(command: Any) -> None:
    component = get_component(import_one({"command": command, "entrypoint": "/entry.sh --now"}))
    assert component["args"] == ["ros2", "launch", "pkg", "my file.py"]
    assert component["command"] == ["/entry.sh", "--now"]


def test_dollars_reach_the_container_as_they_are() -> None:
    component = get_component(import_one({"command": ["sh", "-c", "echo $$(hostname) $$HOME"]}))
    assert component["args"][-1] == "echo $$(hostname) $HOME"


@pytest.mark.parametrize("environment", [{"A": "x=y", "B": 1, "C": True}, ["A=x=y", "B=1", "C=true"]])
def test_environment(environment: Any) -> None:
    component = get_component(import_one({"environment": environment}))
    assert component["env"] == [
        {"name": "A", "value": "x=y"},
        {"name": "B", "value": "1"},
        {"name": "C", "value": "true"},
    ]


def test_words_that_only_kubectl_takes_for_booleans_stay_text() -> None:
    text = "services: {driver: {image: 'ros:jazzy', environment: {A: yes, B: off, C: true}}}"
    result = import_files({"compose.yaml": text})
    assert [entry["value"] for entry in get_component(result)["env"]] == ["yes", "off", "true"]
    assert "value: 'yes'" in format_objects(result.objects)


def test_environment_replaces_env_file_and_a_name_alone_comes_from_the_command_line() -> None:
    service = {"env_file": ["a.env", {"path": "none.env", "required": False}], "environment": ["A=new", "D", "E"]}
    result = import_one(service, files={"a.env": "A=old\nB=b\n"}, variables={"D": "d"})
    assert get_component(result)["env"] == [
        {"name": "A", "value": "new"},
        {"name": "B", "value": "b"},
        {"name": "D", "value": "d"},
    ]
    assert get_verdict(result, "services.driver.environment[2]") is Verdict.LEFT_OUT
    assert get_verdict(result, "services.driver.env_file[1]") is Verdict.LEFT_OUT


@pytest.mark.parametrize(
    ("port", "container", "service"),
    [
        ("8765", {"name": "tcp-8765", "containerPort": 8765}, {"name": "tcp-8765", "port": 8765}),
        (8765, {"name": "tcp-8765", "containerPort": 8765}, {"name": "tcp-8765", "port": 8765}),
        ("80:8080", {"name": "tcp-8080", "containerPort": 8080}, {"name": "tcp-80", "port": 80, "targetPort": 8080}),
        (
            "127.0.0.1:80:8080/udp",
            {"name": "udp-8080", "containerPort": 8080, "protocol": "UDP"},
            {"name": "udp-80", "port": 80, "protocol": "UDP", "targetPort": 8080},
        ),
        (
            {"target": 8080, "published": "80"},
            {"name": "tcp-8080", "containerPort": 8080},
            {"name": "tcp-80", "port": 80, "targetPort": 8080},
        ),
    ],
)
def test_ports_in_each_form(port: Any, container: dict[str, Any], service: dict[str, Any]) -> None:
    component = get_component(import_one({"ports": [port]}))
    assert component["ports"] == [container]
    assert component["service"] == {"spec": {"ports": [service]}}


def test_a_range_of_ports_and_expose() -> None:
    component = get_component(import_one({"ports": ["5000-5002:6000-6002"], "expose": ["7000"]}))
    assert [port["containerPort"] for port in component["ports"]] == [6000, 6001, 6002, 7000]
    assert [port["port"] for port in component["service"]["spec"]["ports"]] == [5000, 5001, 5002, 7000]


@pytest.mark.parametrize("port", ["0:1", "a", "70000", "1-2:1-3", "1:2/icmp", "9-3"])
def test_what_is_no_port_names_file_and_line(port: str) -> None:
    with pytest.raises(ComposeError, match=r"^compose.yaml:5: services.driver.ports\[0\]: .*; write"):
        import_one({"ports": [port]})


def test_a_named_volume_is_a_claim_and_a_folder_is_one_of_the_node() -> None:
    service = {"volumes": ["maps:/maps:ro", "./bags:/bags", "/dev:/dev", "/cache", "~/x:/x"]}
    result = import_one(service, top={"volumes": {"maps": None}}, name="nav")
    claim, app = result.objects
    assert (claim["kind"], claim["metadata"]["name"]) == ("PersistentVolumeClaim", "nav-maps")
    assert app["kind"] == "RobotApp"
    assert get_pod(result)["volumes"] == [
        {"name": "maps", "persistentVolumeClaim": {"claimName": "nav-maps"}},
        {"name": "host-srv-robot-bags", "hostPath": {"path": "/srv/robot/bags"}},
        {"name": "host-dev", "hostPath": {"path": "/dev"}},
        {"name": "data-cache", "emptyDir": {}},
        {"name": "host-choose-a-path-x", "hostPath": {"path": "/CHOOSE-A-PATH/x"}},
    ]
    assert get_component(result)["volumeMounts"][0] == {"name": "maps", "mountPath": "/maps", "readOnly": True}
    assert get_verdict(result, "services.driver.volumes[4]") is Verdict.CHOOSE


def test_a_small_file_beside_the_compose_file_is_a_config_map() -> None:
    service = {"volumes": ["./config/nav.yaml:/nav.yaml", "./keys/robot.pem:/robot.pem", "./big:/big"]}
    files = {"config/nav.yaml": "a: 1\n", "keys/robot.pem": "private", "big": "x" * 300_000}
    result = import_one(service, files=files, name="nav")
    config = result.objects[0]
    assert (config["kind"], config["data"]) == ("ConfigMap", {"nav.yaml": "a: 1\n"})
    assert get_component(result)["volumeMounts"][0] == {
        "name": "file-nav-yaml",
        "mountPath": "/nav.yaml",
        "subPath": "nav.yaml",
        "readOnly": True,
    }
    assert "private" not in str(result.objects)
    assert [("hostPath" in volume) for volume in get_pod(result)["volumes"]] == [False, True, True]


def test_long_volumes_and_memory() -> None:
    service = {
        "volumes": [
            {"type": "bind", "source": "/srv", "target": "/srv", "read_only": True, "bind": {"propagation": "rslave"}},
            {"type": "tmpfs", "target": "/t", "tmpfs": {"size": "64m"}},
        ],
        "tmpfs": "/run:size=1m,mode=755",
        "shm_size": "1gb",
    }
    result = import_one(service)
    assert get_component(result)["volumeMounts"][:2] == [
        {"name": "host-srv", "mountPath": "/srv", "readOnly": True, "mountPropagation": "HostToContainer"},
        {"name": "tmpfs-t", "mountPath": "/t"},
    ]
    assert {"name": "tmpfs-run", "emptyDir": {"medium": "Memory", "sizeLimit": "1Mi"}} in get_pod(result)["volumes"]
    assert get_component(result)["sharedMemory"] == {"size": "1Gi"}


@pytest.mark.parametrize(
    ("volumes", "mounts"),
    [
        (["data:/a", "data:/a:ro"], [{"name": "data", "mountPath": "/a", "readOnly": True}]),
        (["/a", "/a"], [{"name": "data-a", "mountPath": "/a"}]),
        (["/srv:/a/", "/b", "data:/a"], [{"name": "data-b", "mountPath": "/b"}, {"name": "data", "mountPath": "/a"}]),
    ],
)
def test_the_later_of_two_volumes_at_one_path_is_mounted_and_the_other_has_a_line(
    volumes: list[str], mounts: list[dict[str, Any]]
) -> None:
    result = import_one({"volumes": volumes}, top={"volumes": {"data": None}})
    assert get_component(result)["volumeMounts"] == mounts
    assert {volume["name"] for volume in get_pod(result)["volumes"]} == {mount["name"] for mount in mounts}
    (line,) = [line for line in result.report.lines if line.path == "services.driver.volumes[0]"]
    last = f"services.driver.volumes[{len(volumes) - 1}]"
    assert line.verdict is Verdict.LEFT_OUT
    assert line.message.startswith(f"{last} is mounted at /a, too, and the later one wins; ")


def test_a_folder_in_memory_takes_the_place_of_a_volume_of_the_same_path() -> None:
    result = import_one({"volumes": ["/srv:/run"], "tmpfs": ["/run"]})
    assert get_component(result)["volumeMounts"] == [{"name": "tmpfs-run", "mountPath": "/run"}]
    assert [volume["name"] for volume in get_pod(result)["volumes"]] == ["tmpfs-run"]


def test_each_empty_folder_has_a_content_of_its_own() -> None:
    result = import_one({"volumes": ["/a", "/b"], "tmpfs": ["/run", "/shared"]})
    names = [mount["name"] for mount in get_component(result)["volumeMounts"]]
    assert sorted(names) == ["data-a", "data-b", "tmpfs-run", "tmpfs-shared"]


@pytest.mark.parametrize(
    ("device", "wanted"),
    [
        ("/dev/ttyUSB0", {"name": "ttyusb0", "type": "serial", "mountAs": "/dev/ttyUSB0"}),
        ("/dev/ttyUSB0:/dev/ttyUSB0:rw", {"name": "ttyusb0", "type": "serial", "mountAs": "/dev/ttyUSB0"}),
        ("/dev/rplidar:/dev/ttyUSB0", {"name": "rplidar", "type": "serial", "mountAs": "/dev/ttyUSB0"}),
        ("/dev/ttyTHS1", {"name": "ttyths1", "type": "serial", "interface": "ttyTHS1", "mountAs": "/dev/ttyTHS1"}),
        ("/dev/video2", {"name": "video2", "type": "video", "mountAs": "/dev/video2"}),
        ("/dev/i2c-1", {"name": "i2c-1", "type": "i2c", "interface": "i2c-1", "mountAs": "/dev/i2c-1"}),
        ({"source": "/dev/input/js0", "target": "/dev/js0"}, {"name": "js0", "type": "input", "mountAs": "/dev/js0"}),
    ],
)
def test_a_path_that_shows_the_type_is_a_device(device: Any, wanted: dict[str, str]) -> None:
    assert get_component(import_one({"devices": [device]}))["devices"] == [wanted]


def test_another_device_is_a_file_of_the_node() -> None:
    result = import_one({"devices": ["/dev/dri:/dev/dri"]})
    assert get_pod(result)["volumes"] == [{"name": "device-dev-dri", "hostPath": {"path": "/dev/dri"}}]
    assert get_verdict(result, "services.driver.devices[0]") is Verdict.CHANGED


def test_privileges_and_what_belongs_to_the_node() -> None:
    service = {
        "privileged": True,
        "cap_add": ["CAP_SYS_NICE", "net_admin"],
        "security_opt": ["seccomp:unconfined", "no-new-privileges:true"],
        "network_mode": "host",
        "ipc": "host",
        "pid": "host",
        "user": "1000:100",
        "group_add": ["20", "dialout"],
        "shm_size": "64m",
    }
    result = import_one(service)
    assert get_component(result)["securityContext"] == {
        "runAsUser": 1000,
        "runAsGroup": 100,
        "privileged": True,
        "capabilities": {"add": ["SYS_NICE", "NET_ADMIN"]},
        "seccompProfile": {"type": "Unconfined"},
        "allowPrivilegeEscalation": False,
    }
    assert get_pod(result) == {
        "securityContext": {"supplementalGroups": [20]},
        "hostNetwork": True,
        "hostIPC": True,
        "hostPID": True,
    }
    assert get_verdict(result, "services.driver.group_add[1]") is Verdict.LEFT_OUT
    assert get_verdict(result, "services.driver.shm_size") is Verdict.LEFT_OUT


def test_names_and_dns() -> None:
    service = {
        "extra_hosts": ["lidar:10.0.0.5", "up=10.0.0.5", "gw:host-gateway"],
        "dns": "1.1.1.1",
        "hostname": "My_Bot",
    }
    result = import_one(service)
    assert get_pod(result) == {
        "hostAliases": [{"ip": "10.0.0.5", "hostnames": ["lidar", "up"]}],
        "dnsConfig": {"nameservers": ["1.1.1.1"]},
        "hostname": "my-bot",
    }
    assert get_verdict(result, "services.driver.extra_hosts[2]") is Verdict.LEFT_OUT


def test_order_of_start_and_health() -> None:
    services = {
        "base": {
            "image": "ros:jazzy",
            "healthcheck": {
                "test": "check || exit 1",
                "interval": "1m30s",
                "timeout": "500ms",
                "retries": 2,
                "start_period": "1s",
            },
        },
        "once": {"image": "ros:jazzy", "restart": "no"},
        "nav": {
            "image": "ros:jazzy",
            "depends_on": {
                "base": {"condition": "service_healthy"},
                "once": {"condition": "service_completed_successfully"},
            },
        },
        "ui": {"image": "ros:jazzy", "depends_on": ["nav"], "healthcheck": {"disable": True}},
    }
    result = import_services(services)
    assert get_component(result, "base")["readinessProbe"] == {
        "exec": {"command": ["sh", "-c", "check || exit 1"]},
        "periodSeconds": 90,
        "timeoutSeconds": 1,
        "failureThreshold": 2,
    }
    assert get_component(result, "nav")["dependsOn"] == [
        {"component": "base"},
        {"component": "once", "status": "Complete"},
    ]
    assert get_component(result, "once")["job"] == {}
    assert get_component(result, "ui")["dependsOn"] == [{"component": "nav"}]
    assert "readinessProbe" not in get_component(result, "ui")
    assert "job: {}" in find_lines(result, "services.once.restart")[0][1]
    assert get_verdict(result, "services.nav.depends_on.once.condition") is Verdict.TAKEN


def test_resources_and_gpus() -> None:
    gpu = {"driver": "nvidia", "count": 2, "capabilities": ["gpu"]}
    resources = {"limits": {"cpus": "0.5", "memory": "1g"}, "reservations": {"cpus": "0.25", "devices": [gpu]}}
    component = get_component(import_one({"deploy": {"replicas": 3, "resources": resources}}))
    assert component["resources"] == {
        "limits": {"cpu": "500m", "memory": "1Gi", "nvidia.com/gpu": 2},
        "requests": {"cpu": "250m"},
    }
    assert component["replicas"] == 3
    assert get_component(import_one({"gpus": "all"}))["resources"] == {"limits": {"nvidia.com/gpu": 1}}
    assert get_component(import_one({"runtime": "nvidia"}))["resources"] == {"limits": {"nvidia.com/gpu": 1}}


def test_stop_signal_is_a_hook() -> None:
    result = import_one({"stop_signal": "SIGINT", "stop_grace_period": "20s"})
    hook = {"preStop": {"exec": {"command": ["sh", "-c", "kill -INT 1; sleep 20"]}}}
    assert (get_component(result)["lifecycle"], get_pod(result)["terminationGracePeriodSeconds"]) == (hook, 25)


def test_configs_and_secrets() -> None:
    top = {
        "configs": {"nav": {"content": "a: 1\n"}, "out": {"external": True}},
        "secrets": {"key": {"file": "./key.txt"}},
    }
    service = {"configs": ["nav", {"source": "out", "target": "/etc/out"}], "secrets": ["key"]}
    result = import_one(service, top=top, files={"key.txt": "hush"}, name="app")
    assert [entry["kind"] for entry in result.objects] == ["ConfigMap", "RobotApp"]
    assert "hush" not in str(result.objects) + str(result.report)
    assert [mount["mountPath"] for mount in get_component(result)["volumeMounts"]] == [
        "/nav",
        "/etc/out",
        "/run/secrets/key",
    ]
    assert get_pod(result)["volumes"][-1] == {"name": "secret-key", "secret": {"secretName": "app-key"}}


def test_labels_go_where_kubernetes_allows_them() -> None:
    result = import_one({"labels": {"team": "nav", "traefik.rule": "Host(`x`)", "robotics.io/app": "x", "a b": "x"}})
    template = get_component(result)["template"]
    assert template["metadata"] == {"labels": {"team": "nav"}, "annotations": {"traefik.rule": "Host(`x`)"}}
    assert get_verdict(result, 'services.driver.labels["robotics.io/app"]') is Verdict.LEFT_OUT
    assert get_verdict(result, 'services.driver.labels["a b"]') is Verdict.LEFT_OUT


def test_a_built_image_is_marked_and_can_be_given() -> None:
    services = {"nav": {"build": "."}}
    files = {"Dockerfile": "ARG X\nFROM ros:humble-ros-base AS base\n"}
    result = import_services(services, files=files)
    assert get_component(result, "nav")["image"] == "CHOOSE-AN-IMAGE"
    assert result.objects[-1]["spec"]["ros"] == {"distro": "humble"}
    given = import_services(services, files=files, images={"nav": "registry.example/nav:1"})
    assert get_component(given, "nav")["image"] == "registry.example/nav:1"


def test_an_address_of_another_service_is_named() -> None:
    services = {
        "db": {"image": "postgres:16"},
        "api": {"image": "ros:jazzy", "environment": {"URL": "http://db:5432/x"}},
    }
    result = import_services(services)
    assert "kubectl get services" in find_lines(result, "services.api.environment.URL")[0][1]
