"""The command line of a component: a node by `ros2 run`, a container with its nodes by a small launch file of its own."""

from collections.abc import Iterable
from typing import Final

from ros_profile.model.conclusions import LaunchedNode
from ros_profile.model.yaml_words import quote_text
from ros_profile.output.values import quote_unreadable, read_value

MAX_ARGUMENTS: Final = 50
_SPAWNER: Final = ("controller_manager", "spawner")
_ROS_CONTAINER: Final = ("rclcpp_components", "component_container")


def ros1_words(nodes: tuple[LaunchedNode, ...]) -> list[str]:
    plain = next((node for node in nodes if not node.plugin), None)
    node = plain or nodes[0]
    program = (
        ["rosrun", node.package, node.executable]
        if plain
        else ["rosrun", "nodelet", "nodelet", "standalone", node.plugin]
    )
    options = (f"{key}:={value}" for _, key, value in _options(node, "__name", "_"))
    return [*program, *own_arguments(node, node.arguments), *options]


def ros2_words(name: str, nodes: tuple[LaunchedNode, ...], files: dict[str, int]) -> list[str]:
    """Returns how a process is started. `name`: of its component; `files`: position of each parameter file in its `parameters`."""
    plain = next((node for node in nodes if not node.plugin), None)
    loaded = [node for node in nodes if node.plugin]
    if loaded:
        return ["bash", "-c", _container_script(name, plain, loaded, files)]
    node = plain or nodes[0]
    prefix = ["--prefix", node.prefix] if node.prefix and "$" not in node.prefix else []
    options = [word for flag, key, value in _options(node, "__node") for word in (flag, f"{key}:={value}")]
    options += [word for file in absolute_files(node) for word in ("--params-file", file)]
    own = own_arguments(node, complete_arguments(node))
    ros = ["--ros-args", *options] if options else []
    return ["ros2", "run", *prefix, node.package, node.executable, *own, *ros]


def absolute_files(node: LaunchedNode) -> list[str]:
    """Returns the parameter files that lie in the image at a path that the launch file states."""
    return [file for file in node.parameter_files if file.startswith("/") and "$" not in file]


def _container_script(
    name: str, container: LaunchedNode | None, loaded: list[LaunchedNode], files: dict[str, int]
) -> str:
    """Returns a script for a shell that writes a launch file and runs it: no other command of ROS 2 starts a container full."""
    path = f"/tmp/{name}.launch.py"  # noqa: S108
    package, executable = (container.package, container.executable) if container else _ROS_CONTAINER
    called = container.full_name.rpartition("/")[2] if container else f"{name}_container".replace("-", "_")
    namespace = container.namespace if container else "/"
    lines = [
        *(["import os", ""] if files else []),
        "from launch import LaunchDescription",
        "from launch_ros.actions import ComposableNodeContainer",
        "from launch_ros.descriptions import ComposableNode",
        "",
        *(['FILES = os.environ["ROBOTAPP_PARAMETER_FILES"].split(":")', ""] if files else []),
        "",
        "def generate_launch_description():",
        "    return LaunchDescription([ComposableNodeContainer(",
        f"        package={package!r}, executable={executable!r}, name={called!r}, namespace={namespace!r},",
        "        composable_node_descriptions=[",
        *(f"            {_node_text(node, files)}," for node in loaded),
        "        ],",
        "    )])",
    ]
    text = "\n".join(lines)
    return f"cat > {path} <<'END'\n{text}\nEND\nexec ros2 launch {path}\n"


def _node_text(node: LaunchedNode, files: dict[str, int]) -> str:
    fields = {"package": repr(node.package), "plugin": repr(node.plugin)}
    fields["name"] = repr(node.full_name.rpartition("/")[2])
    if node.namespace not in ("", "/") and "$" not in node.namespace:
        fields["namespace"] = repr(node.namespace)
    if remaps := [pair for pair in node.remaps if _is_told(*pair)]:
        fields["remappings"] = repr(remaps)
    values = [f"FILES[{files[file]}]" for file in node.parameter_files if file in files]
    values += [repr(file) for file in absolute_files(node)]
    if pairs := _parameter_literals(node):
        values.append("{" + ", ".join(f"{key!r}: {value}" for key, value in pairs) + "}")
    if values:
        fields["parameters"] = f"[{', '.join(values)}]"
    return f"ComposableNode({', '.join(f'{key}={value}' for key, value in fields.items())})"


def _parameter_literals(node: LaunchedNode) -> list[tuple[str, str]]:
    """Returns the parameters as Python writes values: a text that stays one, or what YAML makes of it."""
    return [
        (key, repr(value if key in node.text_parameters else read_value(value)))
        for key, value in node.parameters
        if _is_told(key, value) or (not value and key in node.text_parameters)
    ]


def complete_arguments(node: LaunchedNode) -> list[str]:
    """Returns the arguments; a spawner stays until it is stopped. Without the flag it ends, and its pod would crash and crash."""
    own = list(node.arguments)
    spawns = (node.package, node.executable) == _SPAWNER and any(own)
    return [*own, "--unload-on-kill"] if spawns and "--unload-on-kill" not in own else own


def own_arguments(node: LaunchedNode, arguments: Iterable[str]) -> list[str]:
    """Returns all of them or none: half a command line may mean something else. A comment has what cannot be told."""
    return [] if is_untold(node) else [text for text in arguments if text]


def is_untold(node: LaunchedNode) -> bool:
    return len(node.arguments) > MAX_ARGUMENTS or any("$" in text or len(text) > 1000 for text in node.arguments)


def _options(node: LaunchedNode, name_key: str, prefix: str = "") -> list[tuple[str, str, str]]:
    """Returns (flag of ROS 2, key, value) of the node's name, namespace, remaps and parameters; what is not known is left out."""
    name = node.full_name.rpartition("/")[2]
    options = [("-r", name_key, name)] if name != node.executable else []
    if node.namespace not in ("", "/"):
        options.append(("-r", "__ns", node.namespace))
    stated = set(node.arguments)
    options += [("-r", *pair) for pair in node.remaps if all(pair) and ":=".join(pair) not in stated]
    options += [("-p", f"{prefix}{key}", value) for key, value in _parameter_words(node, is_ros1=bool(prefix))]
    return [option for option in options if _is_told(option[1], option[2])][:50]


def _parameter_words(node: LaunchedNode, *, is_ros1: bool) -> list[tuple[str, str]]:
    """Returns the parameters as a command line has them: ROS 2 reads each value as YAML, ROS 1 takes the words as they are."""
    pairs = [(key, value) for key, value in node.parameters if len(value) < 200]
    if is_ros1:
        return [(key, value) for key, value in pairs if value]
    return [
        (key, quote_text(value) if key in node.text_parameters else quote_unreadable(value))
        for key, value in pairs
        if value or key in node.text_parameters
    ]


def _is_told(*texts: str) -> bool:
    return all(text and "$" not in text and "\n" not in text for text in texts)
