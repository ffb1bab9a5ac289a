"""Rigelfiles made from a seed: well-formed ones of Rigel 0.2 with mistakes here and there, and broken ones of any kind."""

from collections.abc import Iterator
from copy import deepcopy
from random import Random
from typing import Any, Final

import yaml
from tests.support.rigel.jobfiles import G3, with_block
from tests.support.rigel.rigelfiles import ONE, TWO, orchestration

ENVIRONMENT: Final = {"FROM_ENV": "env", "DEPLOY_KEY": "key"}
"""What both programs find in their environment."""
_NAMES: Final = ("driver", "operator_ui", "base-driver", "Teleop", "a1", "nav2")
_WORDS: Final = (
    "x",
    "acme/driver:1",
    "ghcr.io/a/b@sha256:00",
    "ros2 run a b",
    "{{ tag }}",
    "{{tag}}-{{ FROM_ENV }}",
    "{{ deep }}",
)
_ODD: Final[tuple[Any, ...]] = (
    5,
    1.10,
    True,
    None,
    "",
    [],
    {},
    ["a"],
    {"a": 1},
    "{{ NEVER }}",
    "{{ number }}",
    "{{ x | y }}",
    "a b",
)
_SEEDS: Final = (
    ONE,
    TWO,
    G3,
    with_block("{readiness: {command: 'true'}, persistent_storage: {volumes: [{name: a, size: 1Gi}]}}"),
    orchestration("scheduler: {name: a, policies: {latency_budget: 30ms}, dds_domain: 7}"),
    "application: {distro: noetic}\norchestration: {application_image: 'a/b:1', deploy_ros_master: true}\n",
)
_PIECES: Final = (
    *(
        "null",
        "[]",
        "{}",
        "[[[[",
        "}}}",
        "&a",
        "*a",
        "!!python/object/apply:os.system [id]",
        "{{ vars.x }}",
        "{{x}}",
        "{{",
        "}}",
    ),
    *(
        "- - -",
        "? :",
        "|\n  x",
        ">-",
        "'",
        '"',
        "\t",
        "\x00",
        "\x1b[2J",
        "\u202e",
        "9" * 400,
        "a" * 5000,
        "1e999",
        ".inf",
        "0x" + "f" * 300,
    ),
    *(
        "<<: {a: 1}",
        "---",
        "...",
        "%YAML 9.9",
        "!!binary x",
        "!!python/tuple [1, 2]",
        "true",
        "~",
        "/etc/passwd",
        "../../secret",
        "{{ HOME }}",
    ),
)


def package(random: Random) -> dict[str, Any]:
    """One entry of `packages`, as a user would write it."""
    found: dict[str, Any] = {
        "package": random.choice(_NAMES),
        "distro": random.choice(("humble", "jazzy", "noetic", "{{ distro }}")),
        "image": random.choice(_WORDS),
        "command": random.choice(_WORDS),
    }
    options: dict[str, Any] = {
        "ros_image": "humble-ros-core",
        "apt": ["curl", "{{ tag }}"],
        "compiler": random.choice(("colcon", "catkin_make")),
        "dir": "ws",
        "entrypoint": ["source x"],
        "env": [{"name": "A", "value": random.choice(("1", "{{ tag }}", 7))}],
        "hostname": ["h"],
        "platforms": ["linux/amd64", "linux/arm64"],
        "registry": {"server": "s", "username": "u", "password": "p"},
        "rosinstall": ["r"],
        "run": ["make"],
        "ssh": [{"hostname": "h", "value": "DEPLOY_KEY"}],
        "username": "me",
        "dockerfile": "docker/x",
    }
    found.update({key: options[key] for key in random.sample(sorted(options), random.randrange(4))})
    if random.random() < 0.2:
        found = {"package": found["package"], "image": found["image"], "dockerfile": "docker/x"}
    return found


def first_generation(seed: int) -> str:
    """A Rigelfile of Rigel 0.2, with up to two mistakes."""
    random = Random(seed)
    document: dict[str, Any] = {
        "vars": {"distro": "humble", "tag": "1.4", "number": 3, "deep": "{{ tag }}x"},
        "packages": [package(random) for _ in range(random.randrange(1, 4))],
    }
    if random.random() < 0.5:
        document["deploy"] = [{"name": "robotapp/rigel_bridge", "kwargs": {"orchestration": {}}}]
    if random.random() < 0.3:
        document["simulate"] = {"plugins": [{"name": "a/b"}], "timeout": 5}
    for _ in range(random.choice((0, 0, 1, 1, 2))):
        _mistake(random, document)
    if random.random() < 0.3:
        document = dict(reversed(document.items()))
    return yaml.safe_dump(document, sort_keys=False)


def _mistake(random: Random, document: dict[str, Any]) -> None:
    """Change, drop or misspell one key somewhere."""
    holders = [one for one in _mappings(document) if one]
    if not holders:
        return
    holder = random.choice(holders)
    key = random.choice(sorted(holder))
    kind = random.randrange(4)
    if kind == 0:
        del holder[key]
    elif kind == 1:
        holder[key[:-1] or "z"] = holder.pop(key)
    else:
        holder[key] = deepcopy(random.choice(_ODD))


def _mappings(value: Any) -> Iterator[dict[str, Any]]:
    if isinstance(value, dict):
        yield value
        for child in value.values():
            yield from _mappings(child)
    elif isinstance(value, list):
        for child in value:
            yield from _mappings(child)


def mutated(seed: int) -> bytes:
    """A Rigelfile of some generation after several random changes: every other one stays YAML, the rest mostly does not."""
    random = Random(seed)
    if seed % 2:
        document = yaml.safe_load(random.choice(_SEEDS))
        for _ in range(random.randrange(1, 5)):
            _mistake(random, document)
        return yaml.safe_dump(document, sort_keys=False).encode()
    return _broken(random)


def _broken(random: Random) -> bytes:
    """Lines lost, doubled and moved, words and bytes put in."""
    lines = random.choice(_SEEDS).splitlines()
    for _ in range(random.randrange(1, 6)):
        at = random.randrange(len(lines))
        kind = random.randrange(6)
        if kind == 0 and len(lines) > 1:
            del lines[at]
        elif kind == 1:
            lines.insert(random.randrange(len(lines)), lines[at])
        elif kind == 2:
            lines[at] = " " * random.randrange(1, 5) + lines[at]
        elif kind == 3:
            start, _, _ = lines[at].partition(":")
            lines[at] = f"{start}: {random.choice(_PIECES)}"
        elif kind == 4:
            cut = random.randrange(len(lines[at]) + 1)
            lines[at] = lines[at][:cut] + random.choice(_PIECES) + lines[at][cut:]
        else:
            words = lines[at].split(" ")
            words[random.randrange(len(words))] = random.choice(_PIECES)
            lines[at] = " ".join(words)
    data = bytearray("\n".join(lines).encode("utf-8", "surrogatepass"))
    if random.random() < 0.15:
        for _ in range(3):
            data[random.randrange(len(data))] = random.randrange(256)
    return bytes(data)
