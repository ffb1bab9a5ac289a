"""Properties over generated compose files: every key is named in the report, every value that matters is in the output."""

import json
from collections.abc import Iterator
from typing import Any

from hypothesis import example, given, settings
from hypothesis import strategies as st
from tests.unit.cli.importing.compose import import_files

from robotapp_cli.importing.app import ImportResult
from robotapp_cli.importing.writing import format_objects
from robotapp_cli.lint.findings import Path, Severity, shown
from robotapp_cli.lint.linter import lint

Json = dict[str, Any]
WORDS = st.text("abcxyz019-_", min_size=1, max_size=8)
VALUES = st.one_of(WORDS, st.integers(0, 9999), st.booleans(), st.sampled_from(["a b", "$$x", "x:y", "", "é"]))
NAMES = st.from_regex(r"[A-Z][A-Z0-9_]{0,6}", fullmatch=True).filter(lambda name: not name.startswith("ROBOTAPP_"))
PATHS = st.from_regex(r"/[a-z]{1,6}(/[a-z]{1,6})?", fullmatch=True)
PORTS = st.integers(1, 65535)
PAIRS = st.one_of(
    st.dictionaries(NAMES, VALUES, max_size=4),
    st.dictionaries(NAMES, WORDS, max_size=4).map(lambda pairs: [f"{name}={value}" for name, value in pairs.items()]),
)
PORT = st.one_of(
    PORTS.map(str),
    st.tuples(PORTS, PORTS, st.sampled_from(["", "/udp"])).map(lambda port: f"{port[0]}:{port[1]}{port[2]}"),
    st.builds(lambda target, outside: {"target": target, "published": str(outside), "mode": "host"}, PORTS, PORTS),
)
VOLUME = st.one_of(
    st.tuples(st.sampled_from(["data", "./x", "/srv", "~/y"]), PATHS, st.sampled_from(["", ":ro", ":rw,z"])).map(
        lambda parts: f"{parts[0]}:{parts[1]}{parts[2]}"
    ),
    PATHS,
    st.builds(
        lambda kind, target: {"type": kind, "source": "/srv", "target": target, kind: {"create_host_path": True}},
        st.sampled_from(["bind", "tmpfs", "npipe"]),
        PATHS,
    ),
)
DEVICE = st.sampled_from(
    ["/dev/ttyUSB0", "/dev/ttyACM1:/dev/ttyACM1", "/dev/video0", "/dev/dri:/dev/dri:rwm", "/dev/i2c-1"]
)
COMMAND = st.one_of(WORDS, st.lists(WORDS, min_size=1, max_size=3))
HEALTH = st.fixed_dictionaries(
    {"test": st.one_of(WORDS, st.lists(WORDS, min_size=1, max_size=2).map(lambda words: ["CMD", *words]))},
    optional={
        "interval": st.sampled_from(["10s", "1m30s", 5]),
        "retries": st.integers(1, 9),
        "start_period": st.just("5s"),
        "disable": st.booleans(),
    },
)
DEPLOY = st.fixed_dictionaries(
    {},
    optional={
        "replicas": st.integers(0, 3),
        "mode": st.just("global"),
        "placement": st.just({"constraints": ["node.role == worker"]}),
        "resources": st.fixed_dictionaries(
            {},
            optional={
                "limits": st.just({"cpus": "0.5", "memory": "64m", "pids": 5}),
                "reservations": st.just({"devices": [{"driver": "nvidia", "count": 1, "capabilities": ["gpu"]}]}),
            },
        ),
    },
)
SERVICE = st.fixed_dictionaries(
    {"image": st.sampled_from(["ros:jazzy", "example/nav:jazzy", "postgres:16"])},
    optional={
        "build": st.sampled_from([".", {"context": ".", "args": {"A": 1}}]),
        "command": COMMAND,
        "entrypoint": COMMAND,
        "environment": st.one_of(PAIRS, st.just({"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp", "ROS_DOMAIN_ID": "5"})),
        "ports": st.lists(PORT, max_size=4),
        "expose": st.lists(PORTS, max_size=2),
        "volumes": st.lists(VOLUME, max_size=4, unique_by=str),
        "devices": st.lists(DEVICE, max_size=3, unique=True),
        "tmpfs": st.just(["/run:size=1m,mode=755"]),
        "healthcheck": HEALTH,
        "deploy": DEPLOY,
        "labels": PAIRS,
        "privileged": st.booleans(),
        "network_mode": st.sampled_from(["host", "bridge", "none", "service:x"]),
        "ipc": st.sampled_from(["host", "shareable"]),
        "pid": st.just("host"),
        "cap_add": st.just(["SYS_NICE"]),
        "ulimits": st.just({"rtprio": 99, "nofile": {"soft": 1, "hard": 2}}),
        "restart": st.sampled_from(["no", "always", "on-failure:3"]),
        "user": st.sampled_from(["root", "1000:1000", "robot"]),
        "extra_hosts": st.sampled_from([["a:10.0.0.1", "b:host-gateway"], {"a": "10.0.0.1"}]),
        "networks": st.sampled_from([["default"], {"default": {"aliases": ["x"]}}]),
        "logging": st.just({"driver": "json-file", "options": {"max-size": "1m"}}),
        "stop_signal": st.just("SIGINT"),
        "shm_size": st.sampled_from(["64m", 1024]),
        "gpus": st.sampled_from(
            ["all", [{"driver": "nvidia", "count": "all", "capabilities": ["gpu"], "options": {"a": "b"}}]]
        ),
        "container_name": WORDS,
        "hostname": st.sampled_from(["robot", "My_Robot"]),
        "init": st.booleans(),
        "x-note": st.just({"a": 1}),
        "no_such_key": VALUES,
    },
)
SERVICES = st.dictionaries(st.from_regex("[a-z]{1,6}", fullmatch=True), SERVICE, min_size=1, max_size=3)
TOP = {"volumes": {"data": {"driver": "local"}}, "networks": {"default": None}, "x-all": 1, "version": "3"}


def import_document(services: Json, **request: Any) -> ImportResult:
    """Imports the services; JSON is YAML in which every text is quoted."""
    return import_files({"compose.json": json.dumps({"services": services, **TOP})}, **request)


def list_keys(value: Any, path: Path = ()) -> Iterator[Path]:
    """Yields the path of every key and every entry of a list."""
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for step, part in inner:
        yield (*path, step)
        yield from list_keys(part, (*path, step))


def find_silent_keys(document: Json, result: ImportResult) -> list[str]:
    """Returns the keys that no line of the report is about: none at the key, around it, or within it."""
    named = {line.path for line in result.report.lines}
    silent = []
    for path in list_keys(document):
        around = [shown(path[:end]) for end in range(3 if path[0] == "services" else 1, len(path) + 1)]
        text = shown(path)
        within = any(name.startswith((f"{text}.", f"{text}[")) for name in named)
        if len(path) > 1 and not within and named.isdisjoint(around):
            silent.append(text)
    return silent


@settings(max_examples=300, deadline=None)
@given(SERVICES)
def test_every_key_of_the_file_is_named_in_the_report(services: Json) -> None:
    result = import_document(services)
    assert find_silent_keys({"services": services, **TOP}, result) == []


@settings(max_examples=150, deadline=None)
@given(SERVICES, st.data())
def test_a_key_that_compose_does_not_have_is_named_wherever_it_stands(services: Json, data: st.DataObject) -> None:
    document = json.loads(json.dumps(services))
    free = ("environment", "labels", "extra_hosts", "args", "ulimits")
    bundles = ("build", "logging", "networks", "x-note", "placement", "options", "no_such_key")
    places = [("services", name) for name in document]
    places += [("services", *path) for path in list_keys(document) if not {*path} & {*free, *bundles}]
    at = data.draw(st.sampled_from(places))
    target: Any = document
    for step in at[1:]:
        target = target[step]
    if not isinstance(target, dict):
        return
    target["surprise"] = 1
    result = import_document(document)
    assert shown((*at, "surprise")) in {line.path for line in result.report.lines}


@settings(max_examples=60, deadline=None)
@given(SERVICES)
@example({"a": {"image": "ros:jazzy", "volumes": ["data:/a", "data:/a:ro"]}})
@example({"a": {"image": "ros:jazzy", "volumes": ["/a", "/srv:/a"], "tmpfs": ["/a"]}})
def test_the_output_passes_lint_apart_from_marked_places(services: Json) -> None:
    result = import_document(services, distro="jazzy")
    findings = lint(format_objects(result.objects).encode()).findings
    errors = [finding for finding in findings if finding.severity is Severity.ERROR and finding.reason != "Marked"]
    assert errors == []


@settings(max_examples=150, deadline=None)
@given(SERVICES)
def test_every_variable_port_volume_device_and_command_is_in_the_output(services: Json) -> None:
    result = import_document(services, distro="jazzy")
    components = {component["name"]: component for component in result.objects[-1]["spec"]["components"]}
    for name, service in services.items():
        component = components[name]
        pairs = service.get("environment", {})
        names = set(pairs) if isinstance(pairs, dict) else {pair.partition("=")[0] for pair in pairs}
        if "RMW_IMPLEMENTATION" not in names:
            assert {entry["name"] for entry in component.get("env", [])} == names
        wanted = {_read_target(port) for port in service.get("ports", [])} | set(service.get("expose", []))
        assert {port["containerPort"] for port in component.get("ports", [])} == wanted
        paths = [
            mount["mountPath"].rstrip("/")
            for mount in component.get("volumeMounts", [])
            if "CHOOSE" not in mount["mountPath"]
        ]
        assert len(paths) == len(set(paths))
        mounts = {mount["mountPath"] for mount in component.get("volumeMounts", [])}
        assert {_read_mount(volume) for volume in service.get("volumes", [])} - {None} <= mounts
        hosted = sum(device.startswith("/dev/dri") for device in service.get("devices", []))
        assert len(component.get("devices", [])) + hosted == len(service.get("devices", []))
        for key, field in (("command", "args"), ("entrypoint", "command")):
            words = service.get(key)
            assert component.get(field) == ([words] if isinstance(words, str) else words)


def _read_target(port: Any) -> int:
    return int(port["target"]) if isinstance(port, dict) else int(port.rpartition(":")[2].partition("/")[0])


def _read_mount(volume: Any) -> str | None:
    if isinstance(volume, dict):
        return None if volume["type"] == "npipe" else str(volume["target"])
    return volume.split(":")[1] if ":" in volume else volume


@settings(max_examples=50, deadline=None)
@given(SERVICES)
def test_the_same_files_give_the_same_output_and_report(services: Json) -> None:
    first, second = import_document(services), import_document(services)
    assert (first.objects, first.report.sort()) == (second.objects, second.report.sort())
