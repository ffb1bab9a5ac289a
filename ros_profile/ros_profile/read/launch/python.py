"""Python launch files by `ast`: their statements are followed, nothing is imported or run."""

import ast
import re
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any, Final, TypeVar

from ros_profile.model.facts import Problem
from ros_profile.model.launch import NOT, UNKNOWN_TEXT, Include, LaunchFile, StartedNode
from ros_profile.read.launch import python_values as v
from ros_profile.read.launch.flatten import Flattened
from ros_profile.read.launch.python_calls import CALLS
from ros_profile.read.launch.scope import MAX_NODES, Scope
from ros_profile.read.python.syntax import dotted, parse

MAX_STEPS: Final = 100_000
MAX_DEPTH: Final = 60
MAX_LOOP: Final = 50
_NAMES_PER_STEP: Final = 50
_UNCHANGED: Final = frozenset(
    {"perform", "items", "strip", "lower", "as_posix", "resolve", "copy", "describe", "values", "absolute"}
)
_DESCRIPTION: Final = "LaunchDescription"
_NODE_CLASS: Final = re.compile(r"^[A-Z]\w*[a-z]Node$")
"""Names of classes that are derived from Node, such as CloudNode."""


T = TypeVar("T")


class _BudgetError(Exception):
    """The file is larger than is followed."""


@dataclass(slots=True)
class _Frame:
    """Variables of one function, over those of the module."""

    names: dict[str, Any]
    returned: list[Any] = field(default_factory=list)
    conditions: tuple[str, ...] = ()


@dataclass(slots=True)
class _Evaluator:
    """Follows statements in order, both branches of an `if`, each loop over what is known, local functions."""

    file: str
    functions: dict[str, ast.FunctionDef] = field(default_factory=dict)
    classes: dict[str, ast.ClassDef] = field(default_factory=dict)
    """Classes of the file, for those that derive from one of the launch library."""
    module: dict[str, Any] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)
    steps: int = 0
    depth: int = 0

    def run(self, body: Iterable[ast.stmt], frame: _Frame) -> None:
        for statement in body:
            self._statement(statement, frame)

    def _statement(self, node: ast.stmt, frame: _Frame) -> None:
        if isinstance(node, ast.FunctionDef):
            self.functions[node.name] = node
        elif isinstance(node, ast.Assign):
            value = self.value(node.value, frame)
            for target in node.targets:
                self._assign(target, value, frame)
        elif isinstance(node, ast.ClassDef):
            self.classes[node.name] = node
        elif isinstance(node, ast.AnnAssign) and node.value is not None:
            self._assign(node.target, self.value(node.value, frame), frame)
        elif isinstance(node, ast.AugAssign):
            self._assign(node.target, self._add(self.value(node.target, frame), self.value(node.value, frame)), frame)
        elif isinstance(node, ast.Expr):
            self.value(node.value, frame)
        elif isinstance(node, ast.Return):
            frame.returned.append(self.value(node.value, frame) if node.value else None)
        elif isinstance(node, ast.If):
            self._branches(node, frame)
        elif isinstance(node, ast.For):
            self._loop(node, frame)
        elif isinstance(node, ast.With | ast.Try):
            self.run(node.body, frame)

    def _branches(self, node: ast.If, frame: _Frame) -> None:
        """A test that can be told takes one branch; else both are taken, each under a condition."""
        test = self.value(node.test, frame)
        if isinstance(test, bool):
            self.run(node.body if test else node.orelse, frame)
            return
        text = test if isinstance(test, str) and "$(" in test else UNKNOWN_TEXT
        outer, before = frame.conditions, self._copied(frame.names)
        frame.conditions = (*outer, text)
        self.run(node.body, frame)
        positive, frame.names = frame.names, before
        frame.conditions = (*outer, f"{NOT}{text}")
        self.run(node.orelse, frame)
        frame.conditions = outer
        for name in positive:
            frame.names[name] = _either(text, positive[name], frame.names.get(name, positive[name]))

    def _loop(self, node: ast.For, frame: _Frame) -> None:
        items = self.value(node.iter, frame)
        known = list(items.items()) if isinstance(items, dict) else v.as_list(items)
        for item in known[:MAX_LOOP] if known else [v.UNKNOWN]:
            self._assign(node.target, item, frame)
            self.run(node.body, frame)

    def _assign(self, target: ast.expr, value: Any, frame: _Frame) -> None:
        if isinstance(target, ast.Name):
            frame.names[target.id] = value
        elif isinstance(target, ast.Tuple | ast.List):
            values = list(value) if isinstance(value, list | tuple) else []
            for index, one in enumerate(target.elts):
                self._assign(one, values[index] if index < len(values) else v.UNKNOWN, frame)
        elif isinstance(target, ast.Subscript):
            holder, key = self.value(target.value, frame), self.value(target.slice, frame)
            if isinstance(holder, dict) and isinstance(key, str) and len(holder) < MAX_NODES:
                holder[key] = self._counted(value)

    def value(self, node: ast.expr | None, frame: _Frame) -> Any:
        """What an expression stands for."""
        self.steps += 1
        if self.steps > MAX_STEPS or self.depth > MAX_DEPTH:
            raise _BudgetError
        self.depth += 1
        try:
            found = self._value(node, frame)
        finally:
            self.depth -= 1
        return found[: v.MAX_TEXT] if isinstance(found, str) and len(found) > v.MAX_TEXT else found

    def _counted(self, value: T) -> T:
        """The value, whose size counts as steps: values that hold one another twice grow without end."""
        self.steps += v.weight(value, MAX_STEPS)
        if self.steps > MAX_STEPS:
            raise _BudgetError
        return value

    def _copied(self, names: dict[str, Any]) -> dict[str, Any]:
        self.steps += len(names) // _NAMES_PER_STEP
        return dict(names)

    def _value(self, node: ast.expr | None, frame: _Frame) -> Any:
        if isinstance(node, ast.Constant):
            return node.value if isinstance(node.value, str | int | float | bool | None) else v.UNKNOWN
        if isinstance(node, ast.Name):
            return frame.names.get(node.id, self.module.get(node.id, v.UNKNOWN))
        if isinstance(node, ast.List | ast.Tuple | ast.Set):
            return self._sequence(node.elts, frame)
        if isinstance(node, ast.Dict):
            return self._mapping(node, frame)
        if isinstance(node, ast.JoinedStr):
            parts = [self.value(p.value if isinstance(p, ast.FormattedValue) else p, frame) for p in node.values]
            return v.as_text(parts)
        if isinstance(node, ast.BinOp):
            return self._operation(node, frame)
        if isinstance(node, ast.Call):
            return self._call(node, frame)
        if isinstance(node, ast.Subscript):
            return self._item(node, frame)
        if isinstance(node, ast.Compare) and len(node.ops) == 1:
            return self._comparison(node, frame)
        if isinstance(node, ast.IfExp):
            test = self.value(node.test, frame)
            if isinstance(test, bool):
                return self.value(node.body if test else node.orelse, frame)
            text = test if isinstance(test, str) and "$(" in test else UNKNOWN_TEXT
            return _either(text, self.value(node.body, frame), self.value(node.orelse, frame))
        if isinstance(node, ast.BoolOp):
            return self._logic(node, frame)
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub):
            return self._unary(node, frame)
        if isinstance(node, ast.ListComp):
            return self._comprehension(node, frame)
        return v.UNKNOWN

    def _unary(self, node: ast.UnaryOp, frame: _Frame) -> Any:
        inner = self.value(node.operand, frame)
        if isinstance(node.op, ast.USub):
            return -inner if isinstance(inner, int | float) else v.UNKNOWN
        if isinstance(inner, bool):
            return not inner
        return f"$(not {inner})" if isinstance(inner, str) else v.UNKNOWN

    def _logic(self, node: ast.BoolOp, frame: _Frame) -> Any:
        values = [self.value(one, frame) for one in node.values]
        decisive = isinstance(node.op, ast.Or)
        if any(one is decisive for one in values):
            return decisive
        texts = [
            one if isinstance(one, str) and "$(" in one else UNKNOWN_TEXT for one in values if one is not (not decisive)
        ]
        return f"$({'or' if decisive else 'and'} {' | '.join(texts)})" if texts else not decisive

    def _sequence(self, items: list[ast.expr], frame: _Frame) -> list[Any]:
        found: list[Any] = []
        for item in items:
            if isinstance(item, ast.Starred):
                found += self._counted(v.as_actions(self.value(item.value, frame)))
            else:
                found.append(self.value(item, frame))
        return self._counted(found)

    def _mapping(self, node: ast.Dict, frame: _Frame) -> dict[Any, Any]:
        found: dict[Any, Any] = {}
        for key, value in zip(node.keys, node.values, strict=True):
            one = self.value(value, frame)
            if key is None:
                found.update(one if isinstance(one, dict) else {})
            else:
                found[v.as_text(self.value(key, frame))] = one
        return self._counted(found)

    def _operation(self, node: ast.BinOp, frame: _Frame) -> Any:
        left, right = self.value(node.left, frame), self.value(node.right, frame)
        if isinstance(node.op, ast.Add):
            return self._add(left, right)
        if isinstance(node.op, ast.Div) and isinstance(left, str):
            return f"{left}/{v.as_text(right)}"
        if isinstance(node.op, ast.Mod) and isinstance(left, str) and left.count("%s") == 1:
            return left.replace("%s", v.as_text(right))
        return v.UNKNOWN

    @staticmethod
    def _add(left: Any, right: Any) -> Any:
        if isinstance(left, list) or isinstance(right, list):
            joined = [*v.as_actions(left), *v.as_actions(right)]
            return joined if len(joined) < MAX_NODES else left
        if isinstance(left, str) or isinstance(right, str):
            return v.as_text([left, right])
        return v.UNKNOWN

    def _item(self, node: ast.Subscript, frame: _Frame) -> Any:
        holder, key = self.value(node.value, frame), self.value(node.slice, frame)
        if isinstance(holder, dict) and isinstance(key, str):
            return holder.get(key, v.UNKNOWN)
        if isinstance(holder, list) and isinstance(key, int) and -len(holder) <= key < len(holder):
            return holder[key]
        if dotted(node.value).endswith("os.environ") and isinstance(key, str):
            return v.Text(f"$(env {key})")
        return v.UNKNOWN

    def _comparison(self, node: ast.Compare, frame: _Frame) -> Any:
        left, right = self.value(node.left, frame), self.value(node.comparators[0], frame)
        if (
            isinstance(left, v.Unknown)
            or isinstance(right, v.Unknown)
            or not isinstance(node.ops[0], ast.Eq | ast.NotEq)
        ):
            return v.UNKNOWN
        if isinstance(left, str) and isinstance(right, str) and "$(" in left + right:
            return f"$({'equals' if isinstance(node.ops[0], ast.Eq) else 'notequals'} {left} | {right})"
        return (left == right) == isinstance(node.ops[0], ast.Eq)

    def _comprehension(self, node: ast.ListComp, frame: _Frame) -> list[Any]:
        first = node.generators[0]
        items = v.as_list(self.value(first.iter, frame))
        inner = _Frame(self._copied(frame.names), conditions=frame.conditions)
        found = []
        for item in items[:MAX_LOOP]:
            self._assign(first.target, item, inner)
            found.append(self.value(node.elt, inner))
        return self._counted(found)

    def _call(self, node: ast.Call, frame: _Frame) -> Any:
        name = node.func.attr if isinstance(node.func, ast.Attribute) else dotted(node.func)
        if name == "get" and dotted(node.func).endswith("os.environ.get"):
            name = "getenv"
        if isinstance(node.func, ast.Attribute) and name not in CALLS and not self._is_class(name):
            return self._method(node, node.func, frame)
        if name == "join" and isinstance(node.func, ast.Attribute) and not dotted(node.func.value).endswith("path"):
            return v.UNKNOWN
        if name == "OpaqueFunction":
            return self._opaque(node, frame)
        arguments = self._arguments(node, frame)
        if name in self.functions and dotted(node.func) == name:
            return self._apply(self.functions[name], arguments, frame)
        if name not in CALLS and self._is_class(name):
            name = self._base_of(name, node.lineno)
        if name == _DESCRIPTION:
            return v.Description(v.as_actions(arguments.get("0", arguments.get("initial_entities"))))
        if name.startswith("LaunchConfig"):  # a class of somebody's own, such as one that gives it as a boolean
            name = name if name in CALLS else "LaunchConfiguration"
        if name not in CALLS:
            return v.Unknown(dotted(node.func), node.lineno)
        return _conditioned(CALLS[name](arguments), frame.conditions)

    def _arguments(self, node: ast.Call, frame: _Frame) -> dict[str, Any]:
        found: dict[str, Any] = {"line": node.lineno, "file": self.file}
        for index, argument in enumerate(self._sequence(node.args, frame)):
            found[str(index)] = argument
        for keyword in node.keywords:
            value = self.value(keyword.value, frame)
            if keyword.arg == "value_type":
                found[keyword.arg] = dotted(keyword.value)
            elif keyword.arg is None:
                found.update(value if isinstance(value, dict) else {})
            else:
                found[keyword.arg] = value
        return found

    def _method(self, node: ast.Call, function: ast.Attribute, frame: _Frame) -> Any:
        holder = self.value(function.value, frame)
        arguments = [self.value(argument, frame) for argument in node.args]
        if function.attr in ("add_action", "add_entity", "append") and arguments:
            target = holder.actions if isinstance(holder, v.Description) else holder
            if isinstance(holder, v.Unknown) and holder.call:
                message = (
                    f"what is added to {holder.call}(…) is not followed: it is no description of the launch library"
                )
                self.problems.append(Problem(self.file, message, node.lineno))
            self._counted(arguments[0])
            if isinstance(target, list) and len(target) < MAX_NODES:
                target.append(
                    v.Group([arguments[0]], frame.conditions, scoped=False) if frame.conditions else arguments[0]
                )
            return None
        if function.attr == "perform_substitution" and arguments:
            return arguments[0]
        if function.attr == "extend" and isinstance(holder, list) and arguments:
            holder += self._counted(v.as_actions(arguments[0]))
        elif function.attr == "update" and isinstance(holder, dict) and arguments and isinstance(arguments[0], dict):
            holder.update(self._counted(arguments[0]))
        elif function.attr == "get" and isinstance(holder, dict) and arguments:
            return holder.get(arguments[0] if isinstance(arguments[0], str) else "", v.UNKNOWN)
        elif function.attr in _UNCHANGED:
            return holder
        return v.Unknown(dotted(function), node.lineno)

    def _opaque(self, node: ast.Call, frame: _Frame) -> Any:
        """What the function returns; its context argument is not known."""
        name = next(
            (dotted(k.value) for k in node.keywords if k.arg == "function"), dotted(node.args[0]) if node.args else ""
        )
        if name not in self.functions:
            return v.Unknown(name or "OpaqueFunction", node.lineno)
        given = {k.arg: self.value(k.value, frame) for k in node.keywords if k.arg in ("args", "kwargs")}
        arguments = {str(index): value for index, value in enumerate([v.UNKNOWN, *v.as_list(given.get("args"))])}
        named = given.get("kwargs")
        arguments.update(named if isinstance(named, dict) else {})
        returned = self._apply(self.functions[name], arguments, frame)
        return _conditioned(v.Group(v.as_actions(returned), scoped=False), frame.conditions)

    def _is_class(self, name: str) -> bool:
        """Returns whether a call makes a description or a node, be its class the launch library's or one derived from it."""
        return name.endswith(_DESCRIPTION) or name in self.classes or bool(_NODE_CLASS.search(name))

    def _base_of(self, name: str, line: int) -> str:
        """Returns the class of the launch library that a class stands for, and notes what its own code may change."""
        own, base = self.classes.get(name), name
        for _ in range(MAX_DEPTH):
            if base not in self.classes or not self.classes[base].bases:
                break
            base = dotted(self.classes[base].bases[0]).rpartition(".")[2]
        changed = own is not None and any(isinstance(one, ast.FunctionDef) for one in own.body)
        if base in CALLS or base == _DESCRIPTION:
            known = base
        elif base in self.classes:
            return base
        else:
            known, changed = _DESCRIPTION if base.endswith(_DESCRIPTION) else "Node", True
        if changed and name != _DESCRIPTION:
            message = f"{name} is read as a {known}; what its own code adds or changes is not followed"
            self.problems.append(Problem(self.file, message, line))
        return known

    def _apply(self, function: ast.FunctionDef, arguments: dict[str, Any], frame: _Frame) -> Any:
        """A local function's result; of several returns the actions of all."""
        if self.depth > MAX_DEPTH - 20:
            return v.UNKNOWN
        names = self._copied(frame.names)
        parameters = function.args.posonlyargs + function.args.args
        defaults = [None] * (len(parameters) - len(function.args.defaults)) + list(function.args.defaults)
        for index, (parameter, default) in enumerate(zip(parameters, defaults, strict=True)):
            given = arguments.get(parameter.arg, arguments.get(str(index)))
            names[parameter.arg] = self.value(default, frame) if given is None and default is not None else given
        if function.args.vararg is not None:
            rest = (str(index) for index in range(len(parameters), len(parameters) + len(arguments)))
            names[function.args.vararg.arg] = [arguments[index] for index in rest if index in arguments]
        inner = _Frame(names)
        self.run(function.body, inner)
        lists = [one for one in inner.returned if isinstance(one, list)]
        if len(inner.returned) > 1 and lists:
            return self._counted([action for one in self._counted(lists) for action in one])
        return inner.returned[-1] if inner.returned else None


def _either(test: str, first: Any, second: Any) -> Any:
    """A value that depends on a test: as a text where both are texts, else the first one that is known."""
    if isinstance(first, str) and isinstance(second, str) and first != second and "|" not in first + second:
        return f"$(if {test} | {first} | {second})"
    return second if isinstance(first, v.Unknown) or first is None else first


def _conditioned(value: Any, conditions: tuple[str, ...]) -> Any:
    """Actions made below an `if` are started under its condition."""
    if conditions and isinstance(value, StartedNode | Include | v.Group | v.Container | v.Push):
        return replace(value, conditions=(*conditions, *value.conditions))
    return value


def read_launch_python(data: bytes, file: str) -> LaunchFile:
    """A `.launch.py` file: what `generate_launch_description` gives."""
    module, problems = parse(data, file)
    if module is None:
        return LaunchFile(file, "python", problems=problems)
    evaluator, reading = _Evaluator(file), Flattened(file)
    frame = _Frame(evaluator.module)
    try:
        evaluator.run(module.body, frame)
        function = evaluator.functions.get("generate_launch_description")
        if function is not None:
            returned = _Frame({})
            evaluator.run(function.body, returned)
            for value in returned.returned:
                reading.actions(value.actions if isinstance(value, v.Description) else v.as_actions(value), Scope())
    except (_BudgetError, RecursionError):
        problems = (*problems, Problem(file, "is larger than is followed; what it starts is not known completely"))
    problems = (*problems, *dict.fromkeys((*evaluator.problems, *reading.problems)))
    return LaunchFile(
        file, "python", tuple(reading.arguments), tuple(reading.nodes), tuple(reading.includes), problems=problems
    )
