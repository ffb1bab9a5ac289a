"""Small ROS packages written for the tests, and what the profiler reads from them."""

from collections.abc import Mapping
from pathlib import Path
from textwrap import dedent

from ros_profile.decide.edges import edges, ends_of
from ros_profile.decide.launching import closure
from ros_profile.decide.workspace import Index
from ros_profile.files.load import load
from ros_profile.model.conclusions import Edge
from ros_profile.model.endpoints import Endpoint
from ros_profile.model.launch import LaunchFile
from ros_profile.model.package import Package, SourceFile
from ros_profile.read.launch.python import read_launch_python
from ros_profile.read.launch.xml_file import read_launch_xml
from ros_profile.read.launch.yaml_file import read_launch_yaml
from ros_profile.read.python.source import read_python


def manifest(name: str, *, ros: int = 2, depends: tuple[str, ...] = (), more: str = "") -> str:
    """A valid package.xml."""
    tool = "ament_python" if ros == 2 else "catkin"
    build = f"<buildtool_depend>{'ament_cmake' if ros == 2 else 'catkin'}</buildtool_depend>"
    listed = "".join(f"<depend>{one}</depend>" for one in depends)
    return (
        f'<package format="3"><name>{name}</name><version>1.0.0</version><description>x</description>'
        f'<maintainer email="a@example.org">A</maintainer><license>MIT</license>{build}{listed}{more}'
        f"<export><build_type>{tool}</build_type></export></package>"
    )


def write(root: Path, files: Mapping[str, str | bytes]) -> Path:
    """Files below a folder, texts dedented."""
    for name, content in files.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content if isinstance(content, bytes) else dedent(content).encode())
    return root


def package(
    root: Path, name: str, files: Mapping[str, str | bytes], *, ros: int = 2, depends: tuple[str, ...] = ()
) -> Path:
    """A package's folder below `root`."""
    return write(root / name, {"package.xml": manifest(name, ros=ros, depends=depends), **files})


def python_node(name: str, *made: str, node: str = "") -> dict[str, str]:
    """setup.py and a module with one rclpy node that runs these statements in its constructor."""
    body = "".join(f"        {line}\n" for line in made)
    source = (
        "import rclpy\nfrom rclpy.node import Node\nfrom std_msgs.msg import String\nfrom geometry_msgs.msg import Twist\n"
        "from sensor_msgs.msg import Image\nfrom std_srvs.srv import Trigger\n\n\n"
        f"class Made(Node):\n    def __init__(self):\n        super().__init__('{node or name}')\n{body}\n\ndef main():\n    rclpy.spin(Made())\n"
    )
    return {f"{name}/{name}.py": source}


def setup_py(*names: str) -> dict[str, str]:
    """A setup.py whose console scripts start `main` of the modules of `python_node`."""
    listed = ", ".join(f"'{name} = {name}.{name}:main'" for name in names)
    return {"setup.py": f"from setuptools import setup\nsetup(entry_points={{'console_scripts': [{listed}]}})\n"}


def source(text: str, file: str = "pkg/node.py") -> SourceFile:
    return read_python(dedent(text).encode(), file)


def endpoints(text: str) -> list[tuple[str, str, str]]:
    """(role, name, type) of every endpoint of a Python source."""
    return [_shown(endpoint) for endpoint in source(text).endpoints]


def _shown(endpoint: Endpoint) -> tuple[str, str, str]:
    return endpoint.role.value, endpoint.name, endpoint.type


def launch(text: str, file: str = "launch/a.launch.py") -> LaunchFile:
    """A launch file by the format of its name."""
    data = dedent(text).encode()
    if file.endswith(".py"):
        return read_launch_python(data, file)
    return read_launch_yaml(data, file) if file.endswith(".yaml") else read_launch_xml(data, file)


def loaded(root: Path) -> dict[str, Package]:
    return {one.name: one for one in load(root).packages}


def graph(root: Path, where: str) -> list[Edge]:
    """The edges of the launch file `package/path` of a workspace."""
    packages = loaded(root)
    index = Index(packages.values())
    name, _, path = where.partition("/")
    found = index.launch_file(name, path)
    assert found is not None
    nodes = closure(index, *found).nodes
    return list(edges(ends_of(n, index.unit(n.package, n.node.executable, n.node.plugin), index) for n in nodes))


def triples(root: Path, where: str) -> set[tuple[str, str, str]]:
    """(topic, from, to) of every edge."""
    return {(edge.topic, edge.source, edge.target) for edge in graph(root, where)}
