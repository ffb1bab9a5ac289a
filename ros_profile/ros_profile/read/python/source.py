"""A Python source file: what it imports, makes, derives from, and which texts in it tell of hardware."""

import ast
import sys
from collections.abc import Iterator
from typing import Final

from ros_profile.model.endpoints import Endpoint, Parameter, Timer
from ros_profile.model.facts import Fact, Kind
from ros_profile.model.package import Executable, SourceFile
from ros_profile.read.parameters import text_facts
from ros_profile.read.python.calls import Made, read_call
from ros_profile.read.python.syntax import Walked, dotted, parse, walk
from ros_profile.read.python.values import Names, Scope

MAX_FACTS: Final = 500
_QUIET: Final = frozenset({"rospy", "rclpy", "self", "numpy", "np", "math", "copy", *sys.stdlib_module_names}) - {"os"}
"""Calls into these tell nothing of role or hardware; those of `os` that do are named below."""
_OS: Final = frozenset({"os.sched_setscheduler", "os.sched_param", "os.open"})


def read_python(data: bytes, file: str) -> SourceFile:
    """A module or script of a package."""
    module, problems = parse(data, file)
    if module is None:
        return SourceFile(file, "python", problems=problems)
    nodes = list(walk(module))
    names = Names.of(nodes)
    made: list[Made] = []
    facts: list[Fact] = list(_imports(nodes, file))
    node_names: list[str] = []
    documentation = _documentation(nodes)
    guarded = data.startswith(b"#!")
    for node, owner, function in nodes:
        scope = Scope(names, owner, function)
        if isinstance(node, ast.Call):
            made += read_call(node, scope, file)
            facts += _symbols(node, scope, file)
            if name := _node_name(node, scope):
                node_names.append(name)
                facts.append(Fact(Kind.NODE, names.full(dotted(node.func)) or "super", name, file, node.lineno))
        elif isinstance(node, ast.ClassDef):
            facts += _bases(node, names, file)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in documentation:
            facts += text_facts(node.value, file, node.lineno)
        elif isinstance(node, ast.Compare) and dotted(node.left) == "__name__":
            guarded = True
    return SourceFile(
        file=file,
        language="python",
        facts=tuple(dict.fromkeys(facts))[:MAX_FACTS],
        endpoints=tuple(e for e in made if isinstance(e, Endpoint)),
        timers=tuple(t for t in made if isinstance(t, Timer)),
        parameters=tuple(p for p in made if isinstance(p, Parameter)),
        node_names=tuple(dict.fromkeys(node_names)),
        uses=tuple(sorted(_modules(nodes))),
        executables=_as_script(file) if guarded else (),
        problems=problems,
    )


def _as_script(file: str) -> tuple[Executable, ...]:
    """What can be started by its file name, as ROS 1 scripts are; build files that name it win later."""
    return (Executable(file.rpartition("/")[2], "script", (file,), file=file, line=1),)


def _documentation(nodes: list[Walked]) -> frozenset[int]:
    """Texts that stand alone as a statement: documentation, nothing the program uses."""
    return frozenset(
        id(node.value) for node, _, _ in nodes if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    )


def _imports(nodes: list[Walked], file: str) -> Iterator[Fact]:
    for node, _, _ in nodes:
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield Fact(Kind.INCLUDE, alias.name, "", file, node.lineno)
        elif isinstance(node, ast.ImportFrom) and not node.level and node.module:
            for alias in node.names:
                yield Fact(Kind.INCLUDE, f"{node.module}.{alias.name}", "", file, node.lineno)


def _modules(nodes: list[Walked]) -> set[str]:
    """Modules by dotted name, those of `from x import y` both as x and x.y, because y may be a module."""
    found: set[str] = set()
    for node, _, _ in nodes:
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = "." * node.level + (node.module or "")
            dot = "" if base.endswith(".") or not base else "."
            found.update(f"{base}{dot}{alias.name}" for alias in node.names if alias.name != "*")
            found.add(base)
    return found


def _bases(node: ast.ClassDef, names: Names, file: str) -> Iterator[Fact]:
    for base in node.bases:
        if name := dotted(base):
            yield Fact(Kind.INHERITS, names.full(name), node.name, file, node.lineno)


def _node_name(node: ast.Call, scope: Scope) -> str:
    """The name a call gives to a ROS node."""
    name = dotted(node.func)
    full = scope.names.full(name) if name else ""
    if full in ("rospy.init_node", "rclpy.create_node", "rclpy.node.Node", "rclpy.create_node"):
        return scope.text(node.args[0]) if node.args else _keyword_text(node, scope, "node_name", "name")
    if isinstance(node.func, ast.Attribute) and node.func.attr == "__init__":
        arguments = node.args[1:] if name and not name.startswith("super") else node.args
        text = scope.text(arguments[0]) if arguments else _keyword_text(node, scope, "node_name", "name")
        return text if text.replace("_", "a").isalnum() else ""
    return ""


def _keyword_text(node: ast.Call, scope: Scope, *keywords: str) -> str:
    return next((scope.text(k.value) for k in node.keywords if k.arg in keywords), "")


def _symbols(node: ast.Call, scope: Scope, file: str) -> Iterator[Fact]:
    """Calls into imported libraries, by their full name."""
    name = dotted(node.func)
    if not name:
        if isinstance(node.func, ast.Attribute) and node.func.attr == "cuda":
            yield Fact(Kind.SYMBOL, "cuda", "", file, node.lineno)
        return
    first = name.partition(".")[0]
    full = scope.names.full(name)
    number = node.args[0] if node.args else None
    if full == "cv2.VideoCapture" and isinstance(number, ast.Constant) and type(number.value) is int:
        yield Fact(Kind.DEVICE_PATH, f"/dev/video{number.value}"[:20], "", file, node.lineno)
        yield Fact(Kind.SYMBOL, "cv2.VideoCapture(number)", "", file, node.lineno)
    if full == "cv2.VideoCapture" and any(dotted(one).endswith("CAP_GSTREAMER") for one in node.args[1:]):
        return  # a pipeline, which may begin at a network address
    if full in _OS or (
        first in scope.names.imports and full.lstrip(".").partition(".")[0] not in _QUIET and full[0] != "."
    ):
        yield Fact(Kind.SYMBOL, full, "", file, node.lineno)
    elif name.endswith(".cuda"):
        yield Fact(Kind.SYMBOL, "cuda", "", file, node.lineno)
