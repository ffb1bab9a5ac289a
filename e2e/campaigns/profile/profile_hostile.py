"""Profile: damaged copies of a hostile package: no traceback, nothing outside the package touched, no profile that takes a second.

scripts/bench profile_hostile --packages 2000 --seed 1 --json FILE
"""

import argparse
import json
import os
import random
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from tests.support.ros_sources import manifest, write

from campaigns.common import options
from ros_profile.generate import generate_profile
from ros_profile.output.difference import difference
from ros_profile.output.machine import as_annotations, as_json, as_rigelfile, from_json
from ros_profile.output.robotapp import as_robotapp
from ros_profile.output.text import text

_LISTS = frozenset({"os.listdir", "os.scandir"})
_FORBIDDEN = (
    *("subprocess.", "socket.", "ctypes.", "shutil.", "tempfile.", "pty.", "urllib.", "http.", "glob."),
    *("os.system", "os.exec", "os.fork", "os.posix_spawn", "os.spawn", "os.startfile", "os.chdir", "os.mkdir"),
    *("os.remove", "os.rename", "os.rmdir", "os.link", "os.symlink", "os.chmod", "os.chown", "os.truncate", "os.kill"),
    *("import", "exec", "marshal.", "pickle."),
)
_WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
_watch: "Watch | None" = None


@dataclass(slots=True)
class Watch:
    """Reading below `allowed` is all that may happen. `found` lists every event that goes beyond it."""

    allowed: Path
    found: list[str] = field(default_factory=list)
    opened: int = 0

    def see(self, event: str, arguments: tuple[Any, ...]) -> None:
        if event == "open" or event in _LISTS:
            self._path(event, arguments)
        elif event.startswith(_FORBIDDEN):
            self.found.append(f"{event} {arguments[:1]!r}")

    def _path(self, event: str, arguments: tuple[Any, ...]) -> None:
        given = arguments[0]
        if not given or not isinstance(given, str | bytes | os.PathLike):
            return  # a descriptor, which an open before this one gave; or no name at all, which opens nothing
        self.opened += event == "open"
        path = os.fsdecode(given)
        inside = Path(os.path.realpath(path)).is_relative_to(self.allowed)
        if not inside or (event == "open" and arguments[2] & _WRITES):
            self.found.append(f"{event} {path}")


def _hook(event: str, arguments: tuple[Any, ...]) -> None:
    if _watch is not None:
        _watch.see(event, arguments)


sys.addaudithook(_hook)


@contextmanager
def watched(allowed: Path) -> Iterator[Watch]:
    """Every event within the block is judged; an audit hook cannot be removed, so it looks at what is set here."""
    global _watch  # noqa: PLW0603
    _watch = watch = Watch(Path(os.path.realpath(allowed)))
    try:
        yield watch
    finally:
        _watch = None


_BITS = (
    b"\0",
    b"\xff",
    b"\r",
    b"\t",
    b"'",
    b'"',
    b"(",
    b"]",
    b"{",
    b"&",
    b"*",
    b"<",
    b">",
    b"%",
    b"$(",
    b"\\ud800",
    b"\n",
    b": ",
    b"!!",
    b"\xef\xbb\xbf",
)


def mutated(data: bytes, chance: random.Random) -> bytes:
    """One to four changes: bytes put in, cut out, doubled, or a piece moved."""
    for _ in range(chance.randint(1, 4)):
        at, length = chance.randrange(len(data) + 1), chance.randint(0, 12)
        kind = chance.randrange(4)
        if kind == 0:
            data = data[:at] + chance.choice(_BITS) * chance.choice((1, 1, 2, 50)) + data[at:]
        elif kind == 1:
            data = data[:at] + data[at + length :]
        elif kind == 2:
            data = data[:at] + data[at : at + length] * chance.choice((2, 9)) + data[at + length :]
        else:
            other = chance.randrange(len(data) + 1)
            data = data[:at] + data[other : other + length] + data[at:]
    return data


SECRET: Final = "/dev/ttyUSB4711"
"""Stands in every file outside the package, and in none inside: no profile may hold it."""
_PYTHON: Final = """
import os, rclpy, outside.evil
from ...outside import evil
from thing.yaml import load
from sensor_msgs.msg import Image
from rclpy.node import Node
__import__('outside')
exec(open('{outside}/evil.py').read())
class A(Node):
    def __init__(self):
        super().__init__('a')
        os.system('touch {outside}/pwned')
        self.p = self.create_publisher(Image, open('{outside}/name.txt').read(), qos_profile=10)
        self.declare_parameter('port', open('../../outside/evil.py').read())
def main():
    rclpy.spin(A())
"""
_CPP: Final = """
#include "../../outside/evil.hpp"
#include "{outside}/evil.hpp"
#include <thing/../../../outside/evil.hpp>
#include "/etc/hostname"
class B : public rclcpp::Node {{ B() : Node("b") {{
  p_ = create_publisher<geometry_msgs::msg::Twist>("cmd_vel", rclcpp::QoS(5)); system("touch {outside}/pwned");
  std::ifstream in("{outside}/evil.py"); t_ = create_wall_timer(50ms, [this]() {{ }}); }} }};
RCLCPP_COMPONENTS_REGISTER_NODE(t::B)
int main() {{}}
"""
_CMAKE: Final = """
project(thing LANGUAGES CXX CUDA)
include({outside}/evil.cmake)
include(${{CMAKE_CURRENT_SOURCE_DIR}}/../outside/evil.cmake)
add_subdirectory(../outside)
file(READ {outside}/evil.py X)
execute_process(COMMAND touch {outside}/pwned)
add_executable(run src/a.cpp ../outside/evil.cpp {outside}/evil.cpp)
add_executable(linked src/stolen.cpp)
"""
_LAUNCH_PYTHON: Final = """
import os, outside.evil
open('{outside}/evil.py')
def generate_launch_description():
    secret = os.path.join(get_package_share_directory('thing'), '..', '..', 'outside', 'evil.yaml')
    os.system('touch {outside}/pwned')
    return LaunchDescription([
        IncludeLaunchDescription(PythonLaunchDescriptionSource('{outside}/evil.launch.py')),
        IncludeLaunchDescription(PythonLaunchDescriptionSource('../../outside/evil.launch.py')),
        IncludeLaunchDescription(os.path.join(get_package_share_directory('outside'), 'evil.launch.py')),
        IncludeLaunchDescription('a.launch.py'),
        ExecuteProcess(cmd=['touch', '{outside}/pwned']),
        Node(package='thing', executable='run', parameters=[secret, '{outside}/evil.yaml', '/etc/hostname']),
        Node(package='../outside', executable='../../outside/evil.py'),
    ])
"""
_LAUNCH_XML: Final = """
<launch>
  <include file="/etc/hostname"/> <include file="{outside}/evil.launch"/> <include file="$(find thing)/../outside/evil.launch"/>
  <include file="$(find outside)/evil.launch"/> <include file="$(dirname)/b.launch"/>
  <rosparam command="load" file="../../outside/evil.yaml"/> <param name="x" textfile="{outside}/evil.py"/>
  <param name="y" command="touch {outside}/pwned"/> <arg name="z" default="$(eval __import__('os').system('touch pwned'))"/>
  <node pkg="thing" type="run" name="n" args="$(arg z)"><param from="{outside}/evil.yaml"/></node>
</launch>
"""
_ENTITIES: Final = """<?xml version="1.0"?>
<!DOCTYPE launch SYSTEM "file://{outside}/evil.dtd" [<!ENTITY s SYSTEM "file://{outside}/evil.py"><!ENTITY % p SYSTEM "http://localhost:9/p"> %p;
<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;"><!ENTITY c "&b;&b;&b;&b;&b;&b;&b;&b;">]>
<launch><node pkg="thing" type="run" name="&s;&c;"/></launch>
"""
_XACRO: Final = """
<robot xmlns:xacro="http://ros.org/wiki/xacro" xmlns:xi="http://www.w3.org/2001/XInclude">
  <xi:include href="{outside}/evil.py" parse="text"/> <xacro:include filename="../../outside/evil.xacro"/>
  <xacro:include filename="$(find outside)/evil.xacro"/> <?xml-stylesheet href="file://{outside}/evil.xsl"?>
  <ros2_control name="x" type="system"><hardware><plugin>a/B</plugin><param name="p">${{load_yaml('{outside}/evil.yaml')}}</param></hardware></ros2_control>
</robot>
"""
_YAML: Final = """
a: !include {outside}/evil.yaml
b: !!python/object/apply:os.system ['touch {outside}/pwned']
c: &c [x, x]
d: [*c, *c]
run: {{ros__parameters: {{rate: 20.0, file: {outside}/evil.py}}}}
"""
_SETUP: Final = """
from setuptools import setup
import os; os.system('touch {outside}/pwned'); text = open('{outside}/evil.py').read()
setup(version=text, entry_points={{'console_scripts': ['a = thing.node:main', 'b = ...outside.evil:main', 'c = outside/evil:main']}}, scripts=['../outside/evil.py'])
"""
_FILES: Final = {
    "package.xml": manifest("thing", depends=("rclcpp", "sensor_msgs")),
    "CMakeLists.txt": _CMAKE,
    "setup.py": _SETUP,
    "setup.cfg": "[options.entry_points]\nconsole_scripts =\n  d = ..outside:main\n  e = file: {outside}/evil.py\n",
    "thing/__init__.py": "",
    "thing/node.py": _PYTHON,
    "thing/yaml.py": "raise SystemExit('imported')\n",
    "lxml.py": "raise SystemExit('imported')\n",
    "src/a.cpp": _CPP,
    "launch/a.launch.py": _LAUNCH_PYTHON,
    "launch/b.launch": _LAUNCH_XML,
    "launch/c.launch.yaml": "launch:\n- include: {{file: {outside}/evil.launch}}\n- node: {{pkg: thing, exec: run, param: [{{from: ../../outside/evil.yaml}}]}}\n",
    "launch/d.launch": _ENTITIES,
    "urdf/a.urdf.xacro": _XACRO,
    "urdf/b.urdf": _ENTITIES,
    "config/a.yaml": _YAML,
    "plugins.xml": '<library path="{outside}/evil"><class type="t::B" base_class_type="rclcpp_components::NodeFactory"/></library>',
    "udev/a.rules": 'SUBSYSTEM=="tty", IMPORT{{program}}="{outside}/evil.py", RUN+="{outside}/evil.py"\n',
    "msg/A.msg": "string path {outside}/evil.py\n",
}
_OUTSIDE: Final = {
    f"evil.{ending}": content
    for ending, content in {
        "py": f"import serial\nserial.Serial('{SECRET}')\n",
        "cpp": f'int main() {{ open("{SECRET}"); }}',
        "hpp": f'const char *p = "{SECRET}";',
        "cmake": f"add_executable(evil {SECRET})\n",
        "yaml": f"/**:\n  ros__parameters:\n    port: {SECRET}\n",
        "launch": f'<launch><node pkg="evil" type="evil" name="evil" args="{SECRET}"/></launch>',
        "launch.py": f"def generate_launch_description():\n    return LaunchDescription([Node(package='{SECRET}')])\n",
        "xacro": f"<robot><link name='{SECRET}'/></robot>",
        "dtd": f"<!ENTITY s '{SECRET}'>",
    }.items()
} | {"name.txt": SECRET, "package.xml": manifest("outside")}
_LINKS: Final = {
    "src/stolen.cpp": "../../outside/evil.cpp",
    "src/chain.cpp": "stolen.cpp",
    "src/folder": "../../outside",
    "src/loop": "..",
    "src/self.py": "self.py",
    "thing/stolen.py": "{outside}/evil.py",
    "launch/stolen.launch.py": "{outside}/evil.launch.py",
    "launch/stolen.launch": "../../outside/evil.launch",
    "config/stolen.yaml": "{outside}/evil.yaml",
    "config/machine.yaml": "/etc/hostname",
    "urdf/stolen.xacro": "../../outside/evil.xacro",
    "scripts/dangling": "{outside}/none",
}


@dataclass(frozen=True)
class Hostile:
    """The package at `folder`; what it reaches for lies beside it in `outside`."""

    folder: Path
    files: dict[str, bytes]

    @classmethod
    def made(cls, root: Path) -> "Hostile":
        outside = write(root / "outside", _OUTSIDE)
        files = {
            name: (content if name == "package.xml" else content.format(outside=outside)).encode()
            for name, content in _FILES.items()
        }
        folder = write(root / "thing", files)
        for name, target in _LINKS.items():
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).symlink_to(target.format(outside=outside))
        return cls(folder, files)

    @contextmanager
    def damaged(self, seed: int) -> Iterator[list[str]]:
        """One to three of its files damaged, in every twentieth case its manifest; whole again afterwards."""
        chance = random.Random(seed)
        sources = [name for name in self.files if name != "package.xml"]
        names = chance.sample(sources, chance.randint(1, 3))
        if seed % 20 == 0:
            names = ["package.xml"]
        for name in names:
            (self.folder / name).write_bytes(mutated(self.files[name], chance))
        try:
            yield names
        finally:
            for name in names:
                (self.folder / name).write_bytes(self.files[name])

    def problems(self) -> list[str]:
        """What the whole generator did wrong: left the package, ran or wrote something, raised, or knows a secret."""
        with watched(self.folder) as watch:
            try:
                written = everything(self.folder)
            except Exception:  # noqa: BLE001 - that is what is looked for
                return [traceback.format_exc(limit=-3)]
        known = [f"it knows {SECRET}"] if SECRET in written else []
        return [*watch.found, *known, *([] if watch.opened else ["it read nothing"])]


def everything(folder: Path) -> str:
    """The profile of a package in every format, one after another."""
    profile = generate_profile(folder)
    written = [text(profile, explain=True), as_json(profile), as_annotations(profile), as_rigelfile(profile)]
    written += difference(from_json(as_json(profile)), profile)
    for package in profile.packages:
        written += (as_robotapp(launch, name="thing", distro="jazzy") for launch in package.launches)
    return "\n".join(written)


def seconds(hostile: Hostile) -> float:
    """Processor time of one profile in every format."""
    begun = time.process_time()
    everything(hostile.folder)
    return time.process_time() - begun


HANG_S = 1.0
"""Processor time of one profile in all formats, above which a package hangs the profiler."""


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="scripts/bench profile_hostile", description=__doc__.splitlines()[0] if __doc__ else ""
    )
    parser.add_argument("--packages", type=options.count(1, 1_000_000), default=2000, help="damaged copies to try")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=options.report, help="also write the figures to this file")
    arguments = parser.parse_args(argv)
    with tempfile.TemporaryDirectory() as folder:
        result = _campaign(Hostile.made(Path(folder)), arguments.packages, arguments.seed)
    text = json.dumps(result, indent=2)
    print(text)
    if arguments.json:
        arguments.json.write_text(text + "\n")
    return 1 if result["problems"] else 0


def _campaign(hostile: Hostile, packages: int, first: int) -> dict[str, object]:
    everything(hostile.folder)  # once, so that nothing is imported later
    problems: list[str] = []
    slowest, total = 0.0, 0.0
    for seed in range(first, first + packages):
        with hostile.damaged(seed) as names:
            found = hostile.problems()
            spent = seconds(hostile)
        slowest, total = max(slowest, spent), total + spent
        if spent > HANG_S:
            found.append(f"it took {spent:.2f} s")
        problems += (f"seed {seed}, {', '.join(names)}: {text}" for text in found)
    return {
        "packages": packages,
        "first_seed": first,
        "slowest_s": round(slowest, 3),
        "mean_s": round(total / packages, 4),
        "problems": problems[:50],
    }


if __name__ == "__main__":
    sys.exit(main())
