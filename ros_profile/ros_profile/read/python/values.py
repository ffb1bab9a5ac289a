"""Values of expressions, as far as they can be told without running anything."""

import ast
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Final

from ros_profile.knowledge.qos_presets import PRESETS, preset, with_depth
from ros_profile.model.endpoints import PARAMETER_MARK, Qos
from ros_profile.read.python.syntax import MAX_BITS, Walked, dotted

MAX_STEPS: Final = 12
MAX_TEXT: Final = 500
MAX_EVALUATIONS: Final = 200_000
_PARAMETER_CALLS: Final = frozenset({"get_parameter", "declare_parameter", "get_param", "get_parameter_or"})
_PRESET: Final = "qos_profile_"
"""Before the name of a preset of rmw, as rclpy.qos exports it."""
_POLICIES: Final = ("reliability", "durability", "history", "liveliness")


@dataclass(slots=True)
class Names:
    """What names stand for: imports, and the first plain assignment of each variable (`x`, `Class.self.x`)."""

    imports: dict[str, str] = field(default_factory=dict)
    assigned: dict[str, ast.expr] = field(default_factory=dict)
    left: int = MAX_EVALUATIONS
    """How many expressions of the file are still evaluated: a few lines can name each other without end."""

    @classmethod
    def of(cls, nodes: Iterable[Walked]) -> "Names":
        names = cls()
        for node, owner, function in nodes:
            if isinstance(node, ast.Import):
                for alias in node.names:
                    names.imports[alias.asname or alias.name.partition(".")[0]] = (
                        alias.name if alias.asname else alias.name.partition(".")[0]
                    )
            elif isinstance(node, ast.ImportFrom):
                module_name = "." * node.level + (node.module or "")
                for alias in node.names:
                    names.imports[alias.asname or alias.name] = f"{module_name}.{alias.name}"
            elif isinstance(node, ast.Assign):
                for target in node.targets:
                    names._remember(target, node.value, owner, function)
            elif isinstance(node, ast.AnnAssign) and node.value is not None:
                names._remember(node.target, node.value, owner, function)
        return names

    def _remember(self, target: ast.expr, value: ast.expr, owner: str, function: str) -> None:
        if isinstance(target, ast.Tuple | ast.List) and isinstance(value, ast.Tuple | ast.List):
            for one, its in zip(target.elts, value.elts, strict=False):
                self._remember(one, its, owner, function)
            return
        name = dotted(target)
        if not name:
            return
        if name.startswith("self."):
            self.assigned.setdefault(f"{owner}.{name}", value)
        else:
            self.assigned.setdefault(f"{owner}.{function}.{name}", value)
            if not function and owner:
                self.assigned.setdefault(f"{owner}.self.{name}", value)
                self.assigned.setdefault(f"..{owner}.{name}", value)

    def variable(self, name: str, owner: str, function: str) -> ast.expr | None:
        """What was assigned to a variable seen from a function of a class."""
        if name.startswith(("self.", "cls.")):
            return self.assigned.get(f"{owner}.self.{name.partition('.')[2]}")
        for scope in (f"{owner}.{function}.", f"{owner}..", f".{function}.", ".."):
            if (found := self.assigned.get(scope + name)) is not None:
                return found
        return None

    def full(self, name: str) -> str:
        """A dotted name with what its first part was imported as."""
        first, dot, rest = name.partition(".")
        return self.imports.get(first, first) + dot + rest


def _constant(value: object) -> str:
    if value is None or isinstance(value, bytes) or (isinstance(value, int) and value.bit_length() > MAX_BITS):
        return ""
    return str(value)[:MAX_TEXT]


@dataclass(frozen=True, slots=True)
class Scope:
    """Where an expression stands."""

    names: Names
    owner: str = ""
    function: str = ""

    def text(self, node: ast.AST | None, steps: int = 0) -> str:
        """A text or number as text; `$param:x` for what a parameter gives; empty when it cannot be told."""
        if node is None or steps > MAX_STEPS or self.names.left <= 0:
            return ""
        self.names.left -= 1
        if isinstance(node, ast.Constant):
            return _constant(node.value)
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            inner = self.text(node.operand, steps + 1)
            return f"-{inner}" if inner else ""
        if isinstance(node, ast.JoinedStr):
            return self._joined(node, steps)
        if isinstance(node, ast.BinOp):
            return self._operation(node, steps)
        if isinstance(node, ast.Call):
            return self._call(node, steps)
        if isinstance(node, ast.List | ast.Tuple):
            return ("[" + ", ".join(self.text(item, steps + 1) for item in node.elts[:50]) + "]")[:MAX_TEXT]
        if isinstance(node, ast.BoolOp):
            return next((found for value in node.values if (found := self.text(value, steps + 1))), "")
        if isinstance(node, ast.IfExp):
            return self.text(node.body, steps + 1)
        if isinstance(node, ast.Attribute) and node.attr in (
            "value",
            "string_value",
            "double_value",
            "integer_value",
            "bool_value",
        ):
            inner = self.text(node.value, steps + 1)
            if inner:
                return inner
        return self._variable(node, steps)

    def _variable(self, node: ast.AST, steps: int) -> str:
        name = dotted(node)
        assigned = self.names.variable(name, self.owner, self.function) if name else None
        return self.text(assigned, steps + 1) if assigned is not None else ""

    def _joined(self, node: ast.JoinedStr, steps: int) -> str:
        parts = []
        for part in node.values:
            text = self.text(part.value if isinstance(part, ast.FormattedValue) else part, steps + 1)
            if not text or (text.startswith(PARAMETER_MARK) and len(node.values) > 1):
                return ""
            parts.append(text)
        return "".join(parts)[:MAX_TEXT]

    def _operation(self, node: ast.BinOp, steps: int) -> str:
        left, right = self.text(node.left, steps + 1), self.text(node.right, steps + 1)
        if not left or not right:
            return ""
        try:
            a, b = float(left), float(right)
        except ValueError:
            plain = not left.startswith(PARAMETER_MARK) and not right.startswith(PARAMETER_MARK)
            return (left + right)[:MAX_TEXT] if isinstance(node.op, ast.Add) and plain else ""
        if isinstance(node.op, ast.Div) and b:
            return repr(a / b)
        if isinstance(node.op, ast.Mult):
            return repr(a * b)
        return repr(a + b) if isinstance(node.op, ast.Add) else repr(a - b) if isinstance(node.op, ast.Sub) else ""

    def _call(self, node: ast.Call, steps: int) -> str:
        last = node.func.attr if isinstance(node.func, ast.Attribute) else dotted(node.func)
        if last in _PARAMETER_CALLS and node.args:
            name = self.text(node.args[0], steps + 1)
            return f"{PARAMETER_MARK}{name.lstrip('~/')}" if name and not name.startswith(PARAMETER_MARK) else ""
        if last in ("get_parameter_value", "strip", "rstrip", "lstrip") and isinstance(node.func, ast.Attribute):
            return self.text(node.func.value, steps + 1)
        if last in ("str", "float", "int", "bool", "resolve_name", "Duration", "ParameterValue") and node.args:
            return self.text(node.args[0], steps + 1)
        return ""

    def number(self, node: ast.AST | None) -> float | None:
        text = self.text(node)
        try:
            value = float(text)
        except ValueError:
            return None
        return value if 1e-9 < abs(value) < 1e9 else None

    def type_name(self, node: ast.AST | None) -> str:
        """`package/msg/Name` of a message class, `Name` when its import is not seen."""
        if node is None:
            return ""
        name = dotted(node)
        if not name:
            return ""
        for _ in range(3):  # X = Image
            assigned = self.names.variable(name, self.owner, self.function)
            if assigned is None or not dotted(assigned):
                break
            name = dotted(assigned)
        parts = self.names.full(name).strip(".").split(".")
        for index, part in enumerate(parts[:-1]):
            if part in ("msg", "srv", "action") and index:
                return f"{parts[index - 1]}/{part}/{parts[-1]}"
        return parts[-1]

    def qos(self, node: ast.AST | None, steps: int = 0) -> Qos | None:
        """What a QoS argument states; None when it cannot be told."""
        if node is None or steps > MAX_STEPS:
            return None
        if isinstance(node, ast.Constant):
            return with_depth(node.value) if type(node.value) is int and 0 <= node.value < 1_000_000 else None
        name = dotted(node)
        last = name.rpartition(".")[2]
        if last.removeprefix(_PRESET) in PRESETS and last.startswith(_PRESET):
            return preset(last.removeprefix(_PRESET))
        if "QoSPreset" in name:
            return preset(name.removesuffix(".value").rpartition(".")[2].lower())
        if isinstance(node, ast.Call):
            if isinstance(node.func, ast.Attribute) and "QoSPreset" in dotted(node.func):
                return preset("sensor_data" if "SENSOR" in dotted(node.func) else "")
            return self._qos_profile(node)
        assigned = self.names.variable(name, self.owner, self.function) if name else None
        return self.qos(assigned, steps + 1) if assigned is not None else None

    def _qos_profile(self, node: ast.Call) -> Qos | None:
        if not dotted(node.func).endswith("QoSProfile"):
            return None
        stated = {keyword.arg: keyword.value for keyword in node.keywords if keyword.arg}
        policies = {key: dotted(stated[key]).rpartition(".")[2].lower() for key in _POLICIES if key in stated}
        for key, value in policies.items():  # RMW_QOS_POLICY_RELIABILITY_BEST_EFFORT of the first distributions
            policies[key] = value.removeprefix(f"rmw_qos_policy_{key}_")
        depth = self.number(stated.get("depth") or (node.args[0] if node.args else None))
        bare = with_depth(int(depth) if depth is not None and depth >= 0 else -1)
        return replace(
            bare,
            reliability=policies.get("reliability", bare.reliability),
            durability=policies.get("durability", bare.durability),
            history=policies.get("history", bare.history),
            liveliness=policies.get("liveliness", bare.liveliness),
        )
