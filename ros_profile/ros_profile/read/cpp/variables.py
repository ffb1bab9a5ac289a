"""Which variable holds which parameter, which constant is which text, and the parameters code declares."""

import re
from itertools import islice

from ros_profile.model.endpoints import PARAMETER_MARK, Parameter
from ros_profile.read.cpp.text import literal_of
from ros_profile.read.cpp.tree import Call, Tree

_NAME = r'(?:[\w.>()-]{1,60}\s*\+\s*)?(?:std::string\s*\(\s*)?"\.?([\w./~-]{1,100})"\s*\)?'
_CALLED = (
    r"(?:[gG]et_?[pP]aram|[dD]eclare_?(?:or_get_)?[pP]aram|\bparam|[sS]earchParam)\w{0,30}\s*(?:<[^<>;]{0,60}>\s*)?\("
)
_INTO = re.compile(rf"{_CALLED}\s*(?:[\w*>().-]{{1,60}}\s*,\s*)?{_NAME}\s*,\s*(?:this->|&)?([A-Za-z_][\w.]*)\s*[,)]")
_CALL = re.compile(rf"{_CALLED}\s*(?:[\w*>().-]{{1,60}}\s*,\s*)?{_NAME}")
_ASSIGNED_TO = re.compile(r"([A-Za-z_]\w*)\s*[=({]\s*(?:[\w:<>*.&()-]{0,60}[.>:])?\Z")
_MEMBER_OF_PARAMETERS = re.compile(r"\bparam(?:s|eters|eter|_)?\w{0,10}(?:\.|->)([a-z_]\w*(?:\.[a-z_]\w*){0,4})")
_VALUE = re.compile(r'^(?:-?\d[\d.\']*(?:e-?\d+)?[fFuUlL]*|true|false|"(?:\\.|[^"\\])*")$')
_WRAPPER = re.compile(r"^(?:[\w:]+(?:<[^<>]{0,80}>)?)\s*[({](.*)[)}]$", re.DOTALL)
PARAMETER_CALLS = re.compile(r"(?P<name>[pP]aram(?:eter)?(?!s\b)\w{0,30})(?=\s*[<(])")


MOST_VARIABLES = 2000


def parameter_variables(code: str) -> dict[str, str]:
    """Parameter name by the variable that takes its value."""
    found: dict[str, str] = {}
    for call in islice(_CALL.finditer(code), MOST_VARIABLES):
        if assigned := _ASSIGNED_TO.search(code[max(0, call.start() - 140) : call.start()]):
            found[assigned.group(1)] = call.group(1)
    for name, variable in (match.groups() for match in islice(_INTO.finditer(code), MOST_VARIABLES)):
        found[variable.rsplit(".", 1)[-1]] = name
    return found


def _text_constant(name: str, code: str) -> str:
    """The text of `const char NAME[] = "…"` or `#define NAME "…"`."""
    if not re.fullmatch(r"\w{1,80}", name):
        return ""
    value = r'"((?:\\.|[^"\\\n]){1,200})"'
    found = re.search(rf"\b{name}\s*(?:\[\s*\]\s*)?[={{(]\s*{value}|#[ \t]*define[ \t]+{name}[ \t]+{value}", code)
    return (found.group(1) or found.group(2)) if found else ""


def _resolved_name(name: str, code: str) -> str:
    """The literal in `topic = base->resolve_topic_or_service_name("image", false);`."""
    if not re.fullmatch(r"\w{1,80}", name):
        return ""
    resolving = r"[^;\"]{0,120}?(?:resolve|expand|get)_?\w*(?:topic|name|Name|Topic)\w*\s*\("
    found = re.search(rf'\b{name}\s*=\s*{resolving}[^;"]{{0,80}}"([\w/~]{{1,120}})"', code)
    return found.group(1) if found else ""


def name_of(argument: str, variables: dict[str, str], code: str) -> str:
    """A topic name from an argument: its literal, `$param:…`, or empty."""
    literal = literal_of(argument)
    if literal is not None:
        return literal
    bare = re.sub(r"\b(?:this->|std::string)|[()]|\.c_str|\.as_string|\.to_string", "", argument).strip()
    if bare in variables:
        return PARAMETER_MARK + variables[bare]
    if constant := _text_constant(bare, code):
        return constant
    if member := _MEMBER_OF_PARAMETERS.search(bare):
        return PARAMETER_MARK + member.group(1)
    if name := _resolved_name(bare, code):
        return name
    joined = re.search(r'"(/?[\w/~]{2,100})"', argument)
    return joined.group(1).lstrip("/") if joined and bare.endswith(f'"{joined.group(1)}"') else ""


def constant_text(argument: str) -> str | None:
    """The value of a constant default, unwrapped: `rclcpp::ParameterValue(0.5)` is `0.5`, `std::string("x")` is `x`."""
    text = argument.strip()
    for _ in range(3):
        if _VALUE.match(text):
            return (
                text.strip('"')
                if text.startswith('"')
                else text.rstrip("fFuUlL")
                if text[-1] in "fFuUlL" and text[0] in "-.0123456789"
                else text
            )
        inner = _WRAPPER.match(text)
        if inner is None:
            return None
        text = inner.group(1).strip()
    return None


def declared(tree: Tree, file: str) -> list[Parameter]:
    """Parameters with a constant default: the first literal argument is the name, the first constant after it the value."""
    found: list[Parameter] = []
    for call in tree.calls(PARAMETER_CALLS):
        parameter = _declared(call, tree, file)
        if parameter is not None:
            found.append(parameter)
    return found


def _declared(call: Call, tree: Tree, file: str) -> Parameter | None:
    name = ""
    for argument in call.arguments[:5]:
        if not name:
            text = literal_of(argument)
            tail = re.search(r'\+\s*(?:std::string\s*\(\s*)?"\.?([\w./]{1,100})"\s*\)?$', argument)
            name = text if text is not None else tail.group(1) if tail else ""
            if not name and call.arguments.index(argument) > 1:
                return None
            continue
        value = constant_text(argument)
        if value is not None:
            return Parameter(name.lstrip("~."), value, file, tree.source.line(call.place), owner=call.owner)
    return None
