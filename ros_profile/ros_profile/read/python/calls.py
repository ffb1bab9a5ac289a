"""Calls that make publishers, subscriptions, services, actions, timers and parameters: rclpy and rospy."""

import ast
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

from ros_profile.knowledge.qos_presets import with_depth
from ros_profile.model.endpoints import PARAMETER_MARK, Endpoint, Parameter, Role, Timer
from ros_profile.read.python.syntax import dotted
from ros_profile.read.python.values import Scope

Made = Endpoint | Timer | Parameter


@dataclass(frozen=True, slots=True)
class _Shape:
    """Where a call's arguments stand, and how they are called; -1: it has none."""

    role: Role
    type: int
    name: int
    qos: int = -1
    keywords: tuple[str, str, str] = ("msg_type", "topic", "qos_profile")


_RCLPY: Final = {
    "create_publisher": _Shape(Role.PUBLISHER, 0, 1, 2),
    "create_lifecycle_publisher": _Shape(Role.PUBLISHER, 0, 1, 2),
    "create_subscription": _Shape(Role.SUBSCRIPTION, 0, 1, 3),
    "create_service": _Shape(Role.SERVICE_SERVER, 0, 1, -1, ("srv_type", "srv_name", "qos_profile")),
    "create_client": _Shape(Role.SERVICE_CLIENT, 0, 1, -1, ("srv_type", "srv_name", "qos_profile")),
}
_ROSPY: Final = {
    "rospy.Publisher": _Shape(Role.PUBLISHER, 1, 0, 6, ("data_class", "name", "queue_size")),
    "rospy.Subscriber": _Shape(Role.SUBSCRIPTION, 1, 0, 4, ("data_class", "name", "queue_size")),
    "rospy.Service": _Shape(Role.SERVICE_SERVER, 1, 0, -1, ("service_class", "name", "")),
    "rospy.ServiceProxy": _Shape(Role.SERVICE_CLIENT, 1, 0, -1, ("service_class", "name", "")),
}
_ACTIONS: Final = {
    "ActionServer": Role.ACTION_SERVER,
    "ActionClient": Role.ACTION_CLIENT,
    "SimpleActionServer": Role.ACTION_SERVER,
    "SimpleActionClient": Role.ACTION_CLIENT,
}
_TF: Final = {
    "TransformBroadcaster": (Role.PUBLISHER, "/tf"),
    "StaticTransformBroadcaster": (Role.PUBLISHER, "/tf_static"),
    "TransformListener": (Role.SUBSCRIPTION, "/tf"),
}


def read_call(node: ast.Call, scope: Scope, file: str) -> Iterator[Made]:
    """What one call makes."""
    name = dotted(node.func)
    method = node.func.attr if isinstance(node.func, ast.Attribute) else name
    full = scope.names.full(name) if name else ""
    shape = _ROSPY.get(_rospy_name(full))
    if shape is None and isinstance(node.func, ast.Attribute):
        shape = _RCLPY.get(method)
    if shape is not None:
        yield from _endpoint(node, shape, scope, file)
    elif method in _ACTIONS and ("action" in full or method.startswith("Simple")):
        yield _action(node, _ACTIONS[method], scope, file)
    elif method == "Subscriber" and "message_filters" in full:
        yield from _filter(node, scope, file)
    elif method in _TF and ("tf" in full or full == method):
        role, topic = _TF[method]
        yield Endpoint(role, topic, "tf2_msgs/msg/TFMessage", file, node.lineno, owner=scope.owner)
    elif method in ("create_timer", "create_wall_timer", "create_rate", "Rate", "Timer"):
        yield from _timer(node, method, full, scope, file)
    elif method in ("declare_parameter", "get_param", "declare_parameters"):
        yield from _parameters(node, method, scope, file)


def _rospy_name(full: str) -> str:
    """`rospy.Publisher`, however it was imported."""
    parts = full.split(".")
    return f"rospy.{parts[-1]}" if parts[0] == "rospy" else ""


def _argument(node: ast.Call, index: int, keyword: str) -> ast.expr | None:
    for given in node.keywords:
        if keyword and given.arg == keyword:
            return given.value
    if 0 <= index < len(node.args) and not any(isinstance(a, ast.Starred) for a in node.args[: index + 1]):
        return node.args[index]
    return None


def _endpoint(node: ast.Call, shape: _Shape, scope: Scope, file: str) -> Iterator[Endpoint]:
    type_node = _argument(node, shape.type, shape.keywords[0])
    name_node = _argument(node, shape.name, shape.keywords[1])
    if type_node is None and name_node is None:
        return
    qos_node = _argument(node, shape.qos, shape.keywords[2])
    qos = scope.qos(qos_node) if qos_node is not None else None
    latched = _argument(node, -1, "latch")
    if isinstance(latched, ast.Constant) and latched.value is True:  # of ROS 1
        qos = replace(qos or with_depth(-1), durability="transient_local")
    yield Endpoint(
        role=shape.role,
        name=scope.text(name_node),
        type=scope.type_name(type_node),
        file=file,
        line=node.lineno,
        qos=qos,
        owner=scope.owner,
    )


def _action(node: ast.Call, role: Role, scope: Scope, file: str) -> Endpoint:
    """rclpy: (node, type, name); actionlib: (name, type)."""
    first = 0 if "Simple" in dotted(node.func) or (node.args and isinstance(node.args[0], ast.Constant)) else 1
    if first == 0:
        type_node, name_node = _argument(node, 1, "ActionSpec"), _argument(node, 0, "name")
    else:
        type_node, name_node = _argument(node, 1, "action_type"), _argument(node, 2, "action_name")
    kind = scope.type_name(type_node).replace("/msg/", "/action/").removesuffix("Action")
    return Endpoint(role, scope.text(name_node), kind, file, node.lineno, owner=scope.owner)


def _filter(node: ast.Call, scope: Scope, file: str) -> Iterator[Endpoint]:
    """message_filters.Subscriber: (node, type, topic) or, in ROS 1, (topic, type)."""
    texts = [scope.text(argument) for argument in node.args[:3]]
    ros1 = bool(texts) and bool(texts[0]) and len(node.args) >= 2 and not (len(texts) == 3 and texts[2])
    at = (1, 0) if ros1 else (1, 2)
    type_node, name_node = _argument(node, at[0], "msg_type"), _argument(node, at[1], "topic")
    if type_node is not None:
        qos = scope.qos(_argument(node, 3, "qos_profile"))
        yield Endpoint(
            Role.SUBSCRIPTION, scope.text(name_node), scope.type_name(type_node), file, node.lineno, qos, scope.owner
        )


def _timer(node: ast.Call, method: str, full: str, scope: Scope, file: str) -> Iterator[Timer]:
    if method == "Timer" and not full.startswith("rospy"):
        return
    if method == "Rate" and "." in full and not full.startswith(("rospy", "rclpy")):
        return
    is_rate = method in ("create_rate", "Rate")
    called = _argument(node, 1, "callback")
    runs = "rate" if is_rate else dotted(called).rpartition(".")[2] if called is not None else ""
    argument = _argument(node, 0, "frequency" if is_rate else "timer_period_sec")
    inverse = False
    if isinstance(argument, ast.BinOp) and isinstance(argument.op, ast.Div) and scope.number(argument) is None:
        argument, inverse = argument.right, True  # create_timer(1.0 / self.rate, …)
    text = scope.text(argument)
    if text.startswith(PARAMETER_MARK):
        name = text.removeprefix(PARAMETER_MARK)
        yield Timer(
            file, node.lineno, parameter=name, parameter_is_rate=is_rate != inverse, owner=scope.owner, runs=runs
        )
        return
    value = scope.number(argument)
    if value is not None and value > 0:
        yield Timer(file, node.lineno, 1 / value if is_rate != inverse else value, owner=scope.owner, runs=runs)


def _parameters(node: ast.Call, method: str, scope: Scope, file: str) -> Iterator[Parameter]:
    if method == "declare_parameters":
        entries = _argument(node, 1, "parameters")
        prefix = scope.text(_argument(node, 0, "namespace"))
        for entry in entries.elts if isinstance(entries, ast.List | ast.Tuple) else ():
            if isinstance(entry, ast.Tuple) and entry.elts and (name := scope.text(entry.elts[0])):
                default = scope.text(entry.elts[1]) if len(entry.elts) > 1 else ""
                dot = "." if prefix else ""
                yield Parameter(f"{prefix}{dot}{name}", default, file, entry.lineno, owner=scope.owner)
        return
    name = scope.text(_argument(node, 0, "name")).lstrip("~/")
    if not name or name.startswith(PARAMETER_MARK):
        return
    default_node = _argument(node, 1, "value" if method == "declare_parameter" else "default")
    if method == "get_param" and default_node is None:
        yield Parameter(name, "", file, node.lineno, owner=scope.owner)
        return
    yield Parameter(name, scope.text(default_node), file, node.lineno, owner=scope.owner)
