"""Publishers, subscriptions, services, actions and timers in C++ (rclcpp, roscpp and the usual wrappers)."""

import re
from collections.abc import Iterator
from dataclasses import dataclass

from ros_profile.knowledge.wrappers import WRAPPERS
from ros_profile.model.endpoints import Endpoint, Role, Timer
from ros_profile.read.cpp.quality import qos_of
from ros_profile.read.cpp.text import split_arguments
from ros_profile.read.cpp.times import duration, rate
from ros_profile.read.cpp.tree import Call, Tree
from ros_profile.read.cpp.types import aliases, callback_types, resolved, ros_name, stored_types
from ros_profile.read.cpp.variables import name_of, parameter_variables


@dataclass(frozen=True, slots=True)
class Form:
    """What a call of this name creates; `type` where the name alone tells it."""

    role: Role
    kind: str = "msg"
    type: str = ""


_IMAGE, _TF = "sensor_msgs/msg/Image", "tf2_msgs/msg/TFMessage"
FORMS = {
    "create_publisher": Form(Role.PUBLISHER),
    "create_generic_publisher": Form(Role.PUBLISHER),
    "advertise": Form(Role.PUBLISHER),
    "RealtimePublisher": Form(Role.PUBLISHER),
    "create_subscription": Form(Role.SUBSCRIPTION),
    "create_generic_subscription": Form(Role.SUBSCRIPTION),
    "subscribe": Form(Role.SUBSCRIPTION),
    "Subscriber": Form(Role.SUBSCRIPTION),
    "create_service": Form(Role.SERVICE_SERVER, "srv"),
    "advertiseService": Form(Role.SERVICE_SERVER, "srv"),
    "create_client": Form(Role.SERVICE_CLIENT, "srv"),
    "serviceClient": Form(Role.SERVICE_CLIENT, "srv"),
    "ServiceClient": Form(Role.SERVICE_CLIENT, "srv"),
    "create_server": Form(Role.ACTION_SERVER, "action"),
    "create_action_server": Form(Role.ACTION_SERVER, "action"),
    "SimpleActionServer": Form(Role.ACTION_SERVER, "action"),
    "create_action_client": Form(Role.ACTION_CLIENT, "action"),
    "SimpleActionClient": Form(Role.ACTION_CLIENT, "action"),
    "advertiseCamera": Form(Role.PUBLISHER, type=_IMAGE),
    "create_camera_publisher": Form(Role.PUBLISHER, type=_IMAGE),
    "subscribeCamera": Form(Role.SUBSCRIPTION, type=_IMAGE),
    "create_camera_subscription": Form(Role.SUBSCRIPTION, type=_IMAGE),
}
_CALLS = re.compile(rf"\b(?P<name>{'|'.join(sorted(FORMS, key=len, reverse=True))})(?=\s*[<(])")
_MADE = re.compile(r"\b(?P<name>make_(?:unique|shared))(?=\s*<)")
_NODE = re.compile(
    r"^(?:\*?\s*this|.{0,40}\b\w*(?:[nN]ode|NodeHandle|_nh|nh|parent|lock)\w*(?:->get\(\)|\.get\(\)|\(\)|->[\w()]*)*|.*shared_from_this\(\))$"
)
_CALLBACK = re.compile(r"&\s*(?:[\w:]+::)?(\w+)\b|\bthis->(\w+)\(|\[[^\]]*\]\s*\(\s*([^)]{3,200})\)")
_TIMERS = re.compile(
    r"\b(?P<name>create_(?:wall_)?timer|create(?:Wall|Steady)?Timer|WallRate|Rate)(?=\s*[<({]|\s+\w+\s*[({])"
)
_BROADCASTER = re.compile(r"\b(Static)?TransformBroadcaster\b(?!\.h)")


@dataclass(slots=True)
class Context:
    """What the names in one file stand for."""

    tree: Tree
    file: str
    aliases: dict[str, str]
    callbacks: dict[str, str]
    stored: dict[str, str]
    variables: dict[str, str]


def context(tree: Tree, file: str) -> Context:
    code = tree.source.code
    return Context(tree, file, aliases(code), callback_types(code), stored_types(code), parameter_variables(code))


def endpoints(c: Context) -> list[Endpoint]:
    found = [e for call in c.tree.calls(_CALLS) if (e := _endpoint(c, call, FORMS[call.name])) is not None]
    for call in c.tree.calls(_MADE):
        found += _made(c, call)
    for match in _BROADCASTER.finditer(c.tree.source.code):
        topic = "/tf_static" if match.group(1) else "/tf"
        if not any(e.name == topic for e in found):
            line = c.tree.source.line(match.start())
            found.append(Endpoint(Role.PUBLISHER, topic, _TF, c.file, line, owner=c.tree.owner(match.start())))
    return found


def _made(c: Context, call: Call) -> Iterator[Endpoint]:
    """What a class constructs that `make_unique` or `make_shared` makes."""
    outer, _, inner = call.template.partition("<")
    outer = outer.strip()
    simple = outer.rsplit("::", 1)[-1]
    form = FORMS.get(simple)
    if form is not None and call.arguments:
        made = Call(outer, inner.rstrip("> "), call.arguments, call.place, call.owner, call.receiver)
        if (endpoint := _endpoint(c, made, form)) is not None:
            yield endpoint
    name = _first_name(c, call)
    for wrapped in WRAPPERS.get(simple, WRAPPERS.get(outer, ())) if name else ():
        topic = name if wrapped.topic == "{}" else wrapped.topic.format(name)
        line = c.tree.source.line(call.place)
        yield Endpoint(wrapped.role, topic, wrapped.type, c.file, line, owner=call.owner)


def _first_name(c: Context, call: Call) -> str:
    """The first of its arguments that names something."""
    named = (name_of(argument, c.variables, c.tree.near(call.place)) for argument in call.arguments[:4])
    return next((name for name in named if name), "")


def _endpoint(c: Context, call: Call, form: Form) -> Endpoint | None:
    arguments = list(call.arguments)
    while arguments and '"' not in arguments[0] and _NODE.match(arguments[0]):
        arguments.pop(0)
    if not arguments or _is_declaration(arguments[0]):
        return None
    role, kind = form.role, form.kind
    if call.name == "create_client" and call.receiver == "rclcpp_action":
        role, kind = Role.ACTION_CLIENT, "action"
    name = name_of(arguments[0], c.variables, c.tree.near(call.place))
    kind_of_call = _type(c, call, form, kind)
    if not name and not kind_of_call:
        return None
    line = c.tree.source.line(call.place)
    qos = None
    if role in {Role.PUBLISHER, Role.SUBSCRIPTION} and len(arguments) > 1:
        qos = qos_of(arguments[1], c.tree.near(call.place))
        if qos and call.name == "advertise" and re.search(r",\s*true\s*$", ",".join(arguments)):
            qos = type(qos)(qos.profile, qos.reliability, "transient_local", qos.history, depth=qos.depth)
    return Endpoint(role, name, kind_of_call, c.file, line, qos, call.owner)


def _is_declaration(argument: str) -> bool:
    """`advertise(const std::string & topic, …)` declares a function."""
    return re.match(r"^(?:const\s+)?[\w:]+(?:<[^<>]*>)?\s*[&*]?\s+[&*]?\w+$", argument) is not None


def _type(c: Context, call: Call, form: Form, kind: str) -> str:
    if form.type:
        return form.type
    template = split_arguments(call.template)
    if template:
        first = template[0] if not template[0].startswith("boost") else template[-1]
        return ros_name(resolved(first, c.aliases), kind=kind)
    if call.receiver in c.stored:
        return ros_name(resolved(c.stored[call.receiver], c.aliases), kind=kind)
    if "image_transport" in call.receiver or re.fullmatch(r"_?it_?|image_transport_?|it\d?_?", call.receiver):
        return _IMAGE
    return _callback_type(c, call, kind)


def _callback_type(c: Context, call: Call, kind: str) -> str:
    """From the callback's first parameter: the last argument that names a function of this file, or a lambda."""
    for argument in call.arguments[1:]:
        match = _CALLBACK.search(argument)
        plain = argument.strip() if argument.strip() in c.callbacks else ""
        if match is None and not plain:
            continue
        name = plain or (match and (match.group(1) or match.group(2)))
        if match and not name:
            return ros_name(resolved(re.sub(r"\s+\w+$", "", match.group(3).split(",", 1)[0]), c.aliases), kind=kind)
        if name in c.callbacks:
            found = ros_name(resolved(c.callbacks[name], c.aliases), kind=kind)
            return re.sub(r"/srv/(\w+)(?:::)?Request$", r"/srv/\1", found)
        return f"&{name}"
    return f".{call.receiver}" if call.receiver else ""


_LOOP_CHARACTERS = 2000
"""After the declaration of a rate, in which the loop that sleeps by it stands."""
_BOUND = re.compile(r"&(?:\w+::)*(\w+)")


def timers(c: Context) -> list[Timer]:
    found: list[Timer] = []
    for call in c.tree.calls(_TIMERS):
        arguments = list(call.arguments)
        while len(arguments) > 1 and (_NODE.match(arguments[0]) or "get_clock" in arguments[0]):
            arguments.pop(0)
        if not arguments:
            continue
        read = rate if call.name.endswith("Rate") else duration
        expression = arguments[0]
        span = read(expression, c.variables)
        for _ in range(2):
            if span.seconds >= 0 or span.parameter:
                break
            expression = _substituted(expression, c.tree.near(call.place))
            span = read(expression, c.variables)
        line = c.tree.source.line(call.place)
        runs = _function_run(call, arguments[1:], c)
        found.append(Timer(c.file, line, span.seconds, span.parameter, span.is_rate, call.owner, runs))
    return found


def _function_run(call: Call, arguments: list[str], c: Context) -> str:
    """Returns the name of the function that a timer calls; of a loop or a lambda, whether it publishes."""
    for argument in arguments:
        if bound := _BOUND.search(argument):
            return bound[1]
    code = " ".join(arguments) if arguments else c.tree.source.code[call.place : call.place + _LOOP_CHARACTERS]
    return "publish" if "publish(" in code else ""


def _substituted(expression: str, code: str) -> str:
    """The expression with each local variable replaced by what it was set to: `1.0 / rate` for `period`."""

    def definition(match: re.Match[str]) -> str:
        made = re.search(
            rf"(?<![\w.>]){match.group()}\s*(?:=\s*([^;=]{{1,200}})|[({{]([^;={{}}]{{1,200}})[)}}])\s*;", code
        )
        return f"({made.group(1) or made.group(2)})" if made else match.group()

    return re.sub(r"(?<![\w.:>])[a-z_]\w{1,60}\b(?!\s*[(<:])", definition, expression)[:500]
