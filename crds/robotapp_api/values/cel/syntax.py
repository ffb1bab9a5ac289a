"""The syntax tree of an expression."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Literal:
    """A constant."""

    value: Any


@dataclass(frozen=True, slots=True)
class Identifier:
    """A variable or the name of a type."""

    name: str


@dataclass(frozen=True, slots=True)
class Select:
    """Access to a field: operand.field, or operand.?field."""

    operand: "Node"
    field: str
    optional: bool = False


@dataclass(frozen=True, slots=True)
class Index:
    """Access to an item: operand[index], or operand[?index]."""

    operand: "Node"
    index: "Node"
    optional: bool = False


@dataclass(frozen=True, slots=True)
class Call:
    """A call: function(arguments), or target.function(arguments)."""

    function: str
    target: "Node | None"
    arguments: "tuple[Node, ...]"


@dataclass(frozen=True, slots=True)
class Unary:
    """An operand with `!` or `-` before it."""

    operator: str
    operand: "Node"


@dataclass(frozen=True, slots=True)
class Chain:
    """Operands with operators of one precedence between them, from left to right; a chain may be long, so it is no tree."""

    first: "Node"
    rest: "tuple[tuple[str, Node], ...]"


@dataclass(frozen=True, slots=True)
class Conditional:
    """A choice between two values."""

    condition: "Node"
    yes: "Node"
    no: "Node"


@dataclass(frozen=True, slots=True)
class ListLiteral:
    """A list; an optional item is left out when it has no value."""

    items: "tuple[tuple[Node, bool], ...]"


@dataclass(frozen=True, slots=True)
class MapLiteral:
    """A map; an optional entry is left out when it has no value."""

    entries: "tuple[tuple[Node, Node, bool], ...]"


Node = Literal | Identifier | Select | Index | Call | Unary | Chain | Conditional | ListLiteral | MapLiteral
