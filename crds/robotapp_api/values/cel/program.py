"""Syntax tree to closures, which evaluate it."""

from collections.abc import Callable, Mapping
from typing import Any, Final

from robotapp_api.values.cel import operators
from robotapp_api.values.cel.errors import EvaluationError, ExpressionError, make_overload_error
from robotapp_api.values.cel.evaluation import MOST_ROUNDS, Evaluation, Step
from robotapp_api.values.cel.library.registry import GLOBAL_FUNCTIONS, MEMBER_FUNCTIONS
from robotapp_api.values.cel.macros import COMPREHENSIONS, MACRO_NAMES, compile_macro
from robotapp_api.values.cel.parser import parse
from robotapp_api.values.cel.syntax import (
    Call,
    Chain,
    Conditional,
    Identifier,
    Index,
    ListLiteral,
    Literal,
    MapLiteral,
    Node,
    Select,
    Unary,
)
from robotapp_api.values.cel.values import ABSENT, TYPES, Optional

TOO_DEEP: Final = "the expression is nested too deeply"


class Program:
    """An expression that is ready to be evaluated any number of times."""

    __slots__ = ("_root", "rounds", "text")

    def __init__(self, text: str, root: Step) -> None:
        self.text = text
        self.rounds = 0
        """Rounds of macros in all evaluations so far: what they cost beyond the length of the expression."""
        self._root = root

    def __repr__(self) -> str:
        return f"Program({self.text!r})"

    def evaluate(self, variables: Mapping[str, Any], most_rounds: int = MOST_ROUNDS) -> Any:
        """The value of the expression. Raises EvaluationError, also after so many rounds of its macros."""
        evaluation = Evaluation(dict(variables), most_rounds)
        try:
            return self._root(evaluation)
        except RecursionError:
            raise EvaluationError(TOO_DEEP) from None
        finally:
            self.rounds += evaluation.rounds


def compile_expression(text: str, variables: frozenset[str]) -> Program:
    """Compiles an expression over these variables. Raises ExpressionError."""
    try:
        return Program(text, _Compiler(variables).compile(parse(text)))
    except RecursionError:
        raise ExpressionError(TOO_DEEP) from None


class _Compiler:
    """Compiles nodes in a scope of variables."""

    def __init__(self, variables: frozenset[str]) -> None:
        self._variables = variables

    def compile(self, node: Node) -> Step:
        """The closure of a node."""
        match node:
            case Literal(value):
                return lambda _: value
            case Identifier(name):
                return self._compile_identifier(name)
            case Select(operand, field, optional):
                return operators.compile_select(self.compile(operand), field, optional=optional)
            case Index(operand, index, optional):
                return operators.compile_index(self.compile(operand), self.compile(index), optional=optional)
            case Call():
                return self._compile_call(node)
            case Unary(operator, operand):
                return operators.compile_unary(operator, self.compile(operand))
            case Chain(first, rest):
                return self._compile_chain(first, rest)
            case Conditional(condition, yes, no):
                return operators.compile_conditional(self.compile(condition), self.compile(yes), self.compile(no))
            case ListLiteral(items):
                return _compile_list([(self.compile(item), optional) for item, optional in items])
            case MapLiteral(entries):
                return _compile_map(
                    [(self.compile(key), self.compile(value), optional) for key, value, optional in entries]
                )

    def _compile_identifier(self, name: str) -> Step:
        if name in self._variables:
            return lambda evaluation: evaluation.variables[name]
        if name in TYPES:
            return lambda _: TYPES[name]
        raise ExpressionError(f"undeclared reference to '{name}' (in container '')")

    def _compile_chain(self, first: Node, rest: tuple[tuple[str, Node], ...]) -> Step:
        operator = rest[0][0]
        if operator in {"&&", "||"}:
            steps = [self.compile(first), *(self.compile(operand) for _, operand in rest)]
            return operators.compile_logical(steps, decisive=operator == "||")
        return operators.compile_chain(self.compile(first), [(op, self.compile(operand)) for op, operand in rest])

    def _compile_call(self, call: Call) -> Step:
        macro = self._compile_macro(call)
        if macro is not None:
            return macro
        target, name = call.target, call.function
        if isinstance(target, Identifier) and target.name not in self._variables:
            name, target = f"{target.name}.{name}", None
        functions = GLOBAL_FUNCTIONS if target is None else MEMBER_FUNCTIONS
        if name not in functions:
            raise ExpressionError(f"undeclared reference to '{name}' (in container '')")
        arguments = [self.compile(argument) for argument in ((target,) if target is not None else ()) + call.arguments]
        function, counts = functions[name]
        if len(arguments) not in counts:
            raise ExpressionError(f"found no matching overload for '{name}'")
        return _compile_arguments(function, arguments)

    # --- Macros ------------------------------------------------------------------------------------------------------

    def _compile_macro(self, call: Call) -> Step | None:
        """The closure of a call that is no function, None for functions."""
        target, name, arguments = call.target, call.function, call.arguments
        if target is None:
            return self._compile_has(arguments) if name == "has" else None
        if target == Identifier("cel") and name == "bind" and "cel" not in self._variables:
            return self._compile_bind(arguments)
        if name in {"optMap", "optFlatMap"}:
            return self._compile_optional_map(target, arguments, flat=name == "optFlatMap")
        if name not in MACRO_NAMES:
            return None
        shape = COMPREHENSIONS.get((name, len(arguments)))
        if shape is None:
            raise ExpressionError(f"found no matching overload for '{name}'")
        names = [_get_variable_name(argument) for argument in arguments[: shape.variables]]
        inner = self._add_variables(*names)
        steps = [inner.compile(argument) for argument in arguments[shape.variables :]]
        return compile_macro(shape, names, self.compile(target), steps)

    def _compile_has(self, arguments: tuple[Node, ...]) -> Step:
        if len(arguments) != 1 or not isinstance(arguments[0], Select):
            raise ExpressionError("invalid argument to has() macro")
        return operators.compile_has(self.compile(arguments[0].operand), arguments[0].field)

    def _compile_bind(self, arguments: tuple[Node, ...]) -> Step:
        if len(arguments) != 3:
            raise ExpressionError("found no matching overload for 'cel.bind'")
        name = _get_variable_name(arguments[0])
        value, body = self.compile(arguments[1]), self._add_variables(name).compile(arguments[2])
        return lambda evaluation: evaluation.with_variable(name, value(evaluation), body)

    def _compile_optional_map(self, target: Node, arguments: tuple[Node, ...], *, flat: bool) -> Step:
        if len(arguments) != 2:
            raise ExpressionError("found no matching overload for 'optMap'")
        name = _get_variable_name(arguments[0])
        source, body = self.compile(target), self._add_variables(name).compile(arguments[1])

        def run(evaluation: Evaluation) -> Any:
            value = source(evaluation)
            if not isinstance(value, Optional):
                raise make_overload_error(value)
            if not value.present:
                return ABSENT
            result = evaluation.with_variable(name, value.content, body)
            return result if flat else Optional(present=True, content=result)

        return run

    def _add_variables(self, *names: str) -> "_Compiler":
        return _Compiler(self._variables | set(names))


def _get_variable_name(node: Node) -> str:
    if not isinstance(node, Identifier):
        raise ExpressionError("the argument must be a simple name")
    return node.name


def _compile_arguments(function: Callable[..., Any], arguments: list[Step]) -> Step:
    if len(arguments) == 1:
        (only,) = arguments
        return lambda evaluation: function(only(evaluation))
    if len(arguments) == 2:
        first, second = arguments
        return lambda evaluation: function(first(evaluation), second(evaluation))
    return lambda evaluation: function(*(argument(evaluation) for argument in arguments))


def _compile_list(items: list[tuple[Step, bool]]) -> Step:
    def run(evaluation: Evaluation) -> list[Any]:
        values: list[Any] = []
        for item, optional in items:
            value = item(evaluation)
            if not optional:
                values.append(value)
            elif not isinstance(value, Optional):
                raise make_overload_error(value)
            elif value.present:
                values.append(value.content)
        return values

    return run


def _compile_map(entries: list[tuple[Step, Step, bool]]) -> Step:
    def run(evaluation: Evaluation) -> dict[Any, Any]:
        result: dict[Any, Any] = {}
        for key_step, value_step, optional in entries:
            key, value = operators.get_map_key(key_step(evaluation)), value_step(evaluation)
            if optional:
                if not isinstance(value, Optional):
                    raise make_overload_error(value)
                if not value.present:
                    continue
                value = value.content
            result[key] = value
        return result

    return run
