"""Calls of the launch library in Python launch files, by the name of what is called."""

from collections.abc import Callable
from typing import Any, Final

from ros_profile.model.launch import NOT, UNKNOWN_TEXT, Include, LaunchArgument, StartedNode
from ros_profile.read.launch import python_values as v

Arguments = dict[str, Any]
"""Keyword arguments, and the positional ones under `0`, `1` …; `line` and `file` of the call."""


def _first(arguments: Arguments, *keys: str) -> Any:
    return next((arguments[key] for key in keys if key in arguments), None)


def _text(arguments: Arguments, *keys: str) -> str:
    return v.as_text(_first(arguments, *keys))


def _conditions(arguments: Arguments) -> tuple[str, ...]:
    condition = arguments.get("condition")
    if isinstance(condition, v.Condition):
        return (condition.text,)
    return () if condition is None else (UNKNOWN_TEXT,)


def _argument(arguments: Arguments) -> LaunchArgument:
    default = _first(arguments, "default_value", "1")
    return LaunchArgument(
        _text(arguments, "name", "0"), None if default is None else v.as_text(default), arguments["line"]
    )


def _node(arguments: Arguments, *, plugin: str = "", lifecycle: bool = False) -> StartedNode:
    given = v.as_list(_first(arguments, "parameters"))
    mappings = [one.values if isinstance(one, v.RewrittenFile) else one for one in given]
    values = [entry for one in mappings if isinstance(one, dict) for entry in v.flat(one)][:500]
    files = [v.as_text(one) for one in given if not isinstance(one, dict)]
    return StartedNode(
        package=_text(arguments, "package"),
        executable="" if plugin else _text(arguments, "executable", "node_executable"),
        plugin=plugin,
        name=_text(arguments, "name", "node_name"),
        namespace=_text(arguments, "namespace", "node_namespace"),
        remaps=v.pairs(_first(arguments, "remappings")),
        parameters=tuple((name, value) for name, value, _ in values),
        text_parameters=tuple(name for name, _, is_text in values if is_text),
        environment=(*v.pairs(arguments.get("env")), *v.pairs(arguments.get("additional_env"))),
        prefix=_text(arguments, "prefix"),
        parameter_files=tuple(file for file in files if file)[:50],
        arguments=tuple(v.as_text(one) for one in v.as_list(_first(arguments, "arguments", "ros_arguments")))[:50],
        conditions=_conditions(arguments),
        lifecycle=lifecycle,
        file=arguments["file"],
        line=arguments["line"],
    )


def _composable(arguments: Arguments) -> StartedNode:
    return _node(arguments, plugin=_text(arguments, "plugin", "node_plugin"))


def _container(arguments: Arguments) -> v.Container:
    target = _first(arguments, "target_container")
    name = target.name if isinstance(target, v.Container | StartedNode) else v.as_text(target)
    listed = v.as_list(_first(arguments, "composable_node_descriptions"))
    loaded = [one for one in listed if isinstance(one, StartedNode)]
    if target is not None:
        return v.Container(None, loaded, name, _conditions(arguments))
    node = _node(arguments)
    return v.Container(node, loaded, node.name, node.conditions)


def _include(arguments: Arguments) -> Include:
    given = _first(arguments, "launch_arguments", "1")
    return Include(
        target=_text(arguments, "launch_description_source", "0"),
        arguments=v.pairs(given),
        conditions=_conditions(arguments),
        line=arguments["line"],
    )


def _group(arguments: Arguments) -> v.Group:
    actions = v.as_actions(_first(arguments, "actions", "0"))
    return v.Group(actions, _conditions(arguments), scoped=_first(arguments, "scoped") is not False)


def _later(arguments: Arguments) -> v.Group:
    """Timers and event handlers: what they start later is started."""
    keys = ("actions", "on_exit", "on_start", "on_completion", "entities", "event_handler", "on_shutdown", "1", "0")
    actions = [one for key in keys for one in v.as_list(arguments.get(key)) if key != "on_shutdown"]
    return v.Group([one for one in actions if isinstance(one, v.Action)], _conditions(arguments), scoped=False)


def _events(arguments: Arguments) -> v.Group:
    """OnProcessExit and its like: their target is started where it stands, not here."""
    return _later(
        {key: value for key, value in arguments.items() if key.startswith("on_") or key in ("line", "file", "entities")}
    )


def _joined(arguments: Arguments) -> str:
    parts = [v.as_text(part) for part in v.as_list(_first(arguments, "0", "substitutions"))]
    return "/".join(parts)


def _path(arguments: Arguments) -> str:
    return "/".join(v.as_text(arguments[str(i)]) for i in range(20) if str(i) in arguments)


def _environment(arguments: Arguments) -> str:
    """A substitution: the launch system reads its result as YAML where it is the value of a parameter."""
    default = _first(arguments, "default_value", "1", "default")
    shown = "" if default is None else f" {v.as_text(default)}"
    return f"$(env {_text(arguments, 'name', '0', 'key')}{shown})"


def _process(arguments: Arguments) -> v.Unfollowed:
    words = " ".join(v.as_text(one) for one in v.as_list(_first(arguments, "cmd", "0")))
    return v.Unfollowed(f"a process that is no node gets no component: {words[:200]}", arguments["line"])


def _unfollowed(message: str) -> Callable[[Arguments], v.Unfollowed]:
    """`message` with `{}` for the name that the action is given."""

    def make_action(arguments: Arguments) -> v.Unfollowed:
        name = _text(arguments, "name", "filename", "0")
        return v.Unfollowed(message.format(name[:200]), arguments["line"])

    return make_action


def _rewritten(arguments: Arguments) -> v.RewrittenFile:
    """The values are handed to the node beside the file: where a name is in both, they count."""
    values = arguments.get("param_rewrites")
    return v.RewrittenFile(_text(arguments, "source_file", "0"), values if isinstance(values, dict) else {})


def _typed(arguments: Arguments) -> Any:
    value = _first(arguments, "value", "0")
    return v.Text(v.as_text(value)) if arguments.get("value_type") == "str" else value


def _configuration(arguments: Arguments) -> str:
    default = _first(arguments, "default", "1")
    shown = "" if default is None else f" {v.as_text(default)}"
    return f"$(var {_text(arguments, 'variable_name', '0')}{shown})"


def _words(verb: str) -> Callable[[Arguments], str]:
    def made(arguments: Arguments) -> str:
        return f"$({verb} " + " | ".join(v.as_text(arguments[str(i)]) for i in range(10) if str(i) in arguments) + ")"

    return made


def _equals(arguments: Arguments) -> v.Condition:
    name, value = _text(arguments, "launch_configuration_name", "0"), _text(arguments, "expected_value", "1")
    return v.Condition(f"$(equals $(var {name}) | {value})")


def _pushed(arguments: Arguments) -> v.Push:
    return v.Push(_text(arguments, "namespace", "0"), _conditions(arguments))


def _through(*keys: str) -> Callable[[Arguments], Any]:
    return lambda arguments: _first(arguments, *keys)


def _started(*programs: str) -> Callable[[Arguments], v.Description]:
    """A function of a library that returns a description of these nodes, each `package/executable`."""

    def make_description(arguments: Arguments) -> v.Description:
        place = {key: arguments[key] for key in ("line", "file")}
        pairs = (program.split("/") for program in programs)
        return v.Description([_node({"package": package, "executable": name, **place}) for package, name in pairs])

    return make_description


_MOVE_GROUP, _STATES = "moveit_ros_move_group/move_group", "robot_state_publisher/robot_state_publisher"
_MOVEIT: Final = {
    "generate_demo_launch": _started(_MOVE_GROUP, _STATES, "rviz2/rviz2", "controller_manager/ros2_control_node"),
    "generate_move_group_launch": _started(_MOVE_GROUP),
    "generate_rsp_launch": _started(_STATES),
    "generate_moveit_rviz_launch": _started("rviz2/rviz2"),
    "generate_spawn_controllers_launch": _started("controller_manager/spawner"),
    "generate_static_virtual_joint_tfs_launch": _started("tf2_ros/static_transform_publisher"),
    "generate_setup_assistant_launch": _started(),
    "generate_warehouse_db_launch": _started(),
}
"""What the generated launch files of MoveIt configurations return, by function of moveit_configs_utils."""

CALLS: Final[dict[str, Callable[[Arguments], Any]]] = {
    **_MOVEIT,
    "LaunchConfiguration": _configuration,
    "DeclareLaunchArgument": _argument,
    "SetLaunchConfiguration": lambda a: LaunchArgument(_text(a, "name", "0"), _text(a, "value", "1"), a["line"]),
    "Node": _node,
    "LifecycleNode": lambda a: _node(a, lifecycle=True),
    "ComposableNode": _composable,
    "ComposableLifecycleNode": _composable,
    "ComposableNodeContainer": _container,
    "LoadComposableNodes": _container,
    "IncludeLaunchDescription": _include,
    "GroupAction": _group,
    "TimerAction": _later,
    "RegisterEventHandler": _later,
    "OnProcessExit": _events,
    "OnProcessStart": _events,
    "OnExecutionComplete": _events,
    "OnStateTransition": _events,
    "PushRosNamespace": _pushed,
    "PushROSNamespace": _pushed,
    "SetRemap": lambda a: v.Remap((_text(a, "src", "0"), _text(a, "dst", "1"))),
    "IfCondition": lambda a: v.Condition(_text(a, "predicate_expression", "0")),
    "UnlessCondition": lambda a: v.Condition(f"{NOT}{_text(a, 'predicate_expression', '0')}"),
    "LaunchConfigurationEquals": _equals,
    "LaunchConfigurationNotEquals": lambda a: v.Condition(f"{NOT}{_equals(a).text}"),
    "PathJoinSubstitution": _joined,
    "FindPackageShare": lambda a: f"$(find {_text(a, 'package', '0')})",
    "get_package_share_directory": lambda a: f"$(find {_text(a, 'package_name', '0')})",
    "get_package_share_path": lambda a: f"$(find {_text(a, 'package_name', '0')})",
    "TextSubstitution": lambda a: _text(a, "text", "0"),
    "EnvironmentVariable": _environment,
    "getenv": lambda a: v.Text(_environment(a)),
    "SetEnvironmentVariable": lambda a: v.Environment((_text(a, "name", "0"), _text(a, "value", "1")), _conditions(a)),
    "AppendEnvironmentVariable": _unfollowed("what is appended to the variable {} is not followed; write it under env"),
    "UnsetEnvironmentVariable": _unfollowed("that the variable {} is taken away is not followed"),
    "SetParameter": _unfollowed("parameter {} is set for all nodes, which is not followed; write it for each"),
    "SetParametersFromFile": _unfollowed(
        "parameters of {} are set for all nodes, which is not followed; write them for each"
    ),
    "SetUseSimTime": _unfollowed("use_sim_time is set for all nodes, which is not followed; write it for each"),
    "ExecuteProcess": _process,
    "ExecuteLocal": _process,
    **dict.fromkeys(("LogInfo", "Shutdown", "EmitEvent", "UnregisterEventHandler"), lambda _: v.Group([])),
    "ThisLaunchFileDir": lambda _: "$(dirname)",
    "PythonExpression": lambda a: f"$(eval {_text(a, 'expression', '0')})",
    "NotSubstitution": _words("not"),
    "AndSubstitution": _words("and"),
    "OrSubstitution": _words("or"),
    "AnySubstitution": _words("or"),
    "AllSubstitution": _words("and"),
    "EqualsSubstitution": _words("equals"),
    "NotEqualsSubstitution": _words("notequals"),
    "PythonLaunchDescriptionSource": _through("launch_file_path", "0"),
    "XMLLaunchDescriptionSource": _through("launch_file_path", "0"),
    "YAMLLaunchDescriptionSource": _through("launch_file_path", "0"),
    "AnyLaunchDescriptionSource": _through("launch_file_path", "0"),
    "FrontendLaunchDescriptionSource": _through("launch_file_path", "0"),
    "ParameterFile": _through("param_file", "0"),
    "RewrittenYaml": _rewritten,
    "ParameterValue": _typed,
    "ReplaceString": _through("source_file", "0"),
    "eval": lambda a: f"$(eval {_text(a, '0')})",
    "str": _through("0"),
    "bool": _through("0"),
    "int": _through("0"),
    "float": _through("0"),
    "list": _through("0"),
    "tuple": _through("0"),
    "Path": _path,
    "join": _path,
}
