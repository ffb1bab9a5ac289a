"""Text to syntax tree, by the grammar of CEL."""

import re
from collections.abc import Iterator
from typing import Final, NamedTuple

from robotapp_api.values.cel.errors import ExpressionError
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
from robotapp_api.values.cel.values import INT64, UINT64, Unsigned

MAX_LENGTH: Final = 10 * 1024
"""Longest selector that the API server accepts."""
MAX_DEPTH: Final = 50
"""Expressions within expressions; the API server allows 250 of its own parser's rules."""

_TOKEN: Final = re.compile(
    r"""
    (?P<space>[ \t\r\n\f]+|//[^\n]*)
    |(?P<string>(?P<prefix>[bBrR]{0,2})(?P<quoted>\"{3}|'{3}|"|'))
    |(?P<float>[0-9]*\.[0-9]+(?:[eE][+-]?[0-9]+)?|[0-9]+[eE][+-]?[0-9]+)
    |(?P<int>0x[0-9a-fA-F]+|[0-9]+)(?P<unsigned>[uU])?
    |(?P<name>[_a-zA-Z][_a-zA-Z0-9]*)
    |(?P<operator>&&|\|\||==|!=|<=|>=|[-+*/%!<>?:.,()\[\]{}])
    """,
    re.VERBOSE,
)
_ESCAPE: Final = re.compile(
    r"\\(?:(?P<simple>[abfnrtv\\?\"'`])|[xX](?P<x>[0-9a-fA-F]{2})|u(?P<u>[0-9a-fA-F]{4})|U(?P<w>[0-9a-fA-F]{8})"
    r"|(?P<octal>[0-3][0-7]{2})|(?P<bad>.?))",
    re.DOTALL,
)
_SIMPLE: Final = dict(zip("abfnrtv", "\a\b\f\n\r\t\v", strict=True))
_LEVELS: Final = (
    ("||",),
    ("&&",),
    ("==", "!=", "<", "<=", ">", ">=", "in"),
    ("+", "-"),
    ("*", "/", "%"),
)
_WORDS: Final = {"true": True, "false": False, "null": None}
_RESERVED: Final = frozenset(
    [
        "as",
        "break",
        "const",
        "continue",
        "else",
        "for",
        "function",
        "if",
        "import",
        "let",
        "loop",
        "package",
        "namespace",
        "return",
        "var",
        "void",
        "while",
    ]
)


class Token(NamedTuple):
    """A piece of the text. `value` is that of a constant."""

    kind: str
    text: str
    offset: int
    value: bool | int | float | str | bytes | None = None


def parse(text: str) -> Node:
    """Parses an expression. Raises ExpressionError."""
    if len(text.encode()) > MAX_LENGTH:
        raise ExpressionError(f"the expression is longer than {MAX_LENGTH} bytes")
    return _Parser(text).parse()


class _Parser:
    """A parser by recursive descent that looks one token ahead."""

    def __init__(self, text: str) -> None:
        self._tokens = _split_into_tokens(text)
        self._depth = 0
        self._token = next(self._tokens)

    def parse(self) -> Node:
        node = self._parse_expression()
        if self._token.kind != "end":
            raise self._make_error()
        return node

    def _parse_expression(self) -> Node:
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise ExpressionError(f"the expression is nested deeper than {MAX_DEPTH} levels")
        node = self._parse_chain(0)
        if self._accept("?"):
            yes = self._parse_chain(0)
            self._expect(":")
            node = Conditional(node, yes, self._parse_expression())
        self._depth -= 1
        return node

    def _parse_chain(self, level: int) -> Node:
        if level == len(_LEVELS):
            return self._parse_unary()
        first = self._parse_chain(level + 1)
        rest: list[tuple[str, Node]] = []
        while self._token.text in _LEVELS[level] and self._token.kind in {"operator", "name"}:
            operator = self._advance().text
            rest.append((operator, self._parse_chain(level + 1)))
        return Chain(first, tuple(rest)) if rest else first

    def _parse_unary(self) -> Node:
        operators: list[str] = []
        while self._token.kind == "operator" and self._token.text in {"!", "-"}:
            operators.append(self._advance().text)
            if operators[-1] == "-" and self._token.kind == "number" and not isinstance(self._token.value, Unsigned):
                token = self._advance()
                operators.pop()
                node = self._parse_members(Literal(-_read_number(token)))
                break
        else:
            node = self._parse_members(self._parse_primary())
        for operator in reversed(operators):
            node = Unary(operator, node)
        if isinstance(node, Literal) and type(node.value) is int and node.value not in INT64:
            raise ExpressionError("invalid int literal")
        return node

    def _parse_members(self, node: Node) -> Node:
        while True:
            if self._accept("."):
                optional = self._accept("?")
                name = self._parse_name()
                if not optional and self._accept("("):
                    node = Call(name, node, self._parse_arguments(")"))
                else:
                    node = Select(node, name, optional)
            elif self._accept("["):
                optional = self._accept("?")
                index = self._parse_expression()
                self._expect("]")
                node = Index(node, index, optional)
            else:
                return node

    def _parse_primary(self) -> Node:
        token = self._token
        if token.kind in {"number", "string"}:
            return Literal(self._advance().value)
        if token.kind == "name":
            return self._parse_identifier()
        if self._accept("."):
            return self._parse_identifier()
        if self._accept("("):
            node = self._parse_expression()
            self._expect(")")
            return node
        if self._accept("["):
            return self._parse_list()
        if self._accept("{"):
            return self._parse_map()
        raise self._make_error()

    def _parse_identifier(self) -> Node:
        if self._token.text in _WORDS:
            return Literal(_WORDS[self._advance().text])
        name = self._parse_name()
        if name in _RESERVED:
            raise ExpressionError(f"reserved identifier: {name}")
        if self._accept("("):
            return Call(name, None, self._parse_arguments(")"))
        return Identifier(name)

    def _parse_name(self) -> str:
        if self._token.kind != "name" or self._token.text in {*_WORDS, "in"}:
            raise self._make_error()
        return self._advance().text

    def _parse_arguments(self, closing: str) -> tuple[Node, ...]:
        arguments: list[Node] = []
        while not self._accept(closing):
            if arguments:
                self._expect(",")
            arguments.append(self._parse_expression())
        return tuple(arguments)

    def _parse_list(self) -> Node:
        items: list[tuple[Node, bool]] = []
        while not self._accept("]"):
            if items:
                self._expect(",")
                if self._accept("]"):
                    break
            optional = self._accept("?")
            items.append((self._parse_expression(), optional))
        return ListLiteral(tuple(items))

    def _parse_map(self) -> Node:
        entries: list[tuple[Node, Node, bool]] = []
        while not self._accept("}"):
            if entries:
                self._expect(",")
                if self._accept("}"):
                    break
            optional = self._accept("?")
            key = self._parse_expression()
            self._expect(":")
            entries.append((key, self._parse_expression(), optional))
        return MapLiteral(tuple(entries))

    def _advance(self) -> Token:
        token, self._token = self._token, next(self._tokens)
        return token

    def _accept(self, text: str) -> bool:
        if self._token.kind != "operator" or self._token.text != text:
            return False
        self._advance()
        return True

    def _expect(self, text: str) -> None:
        if not self._accept(text):
            raise self._make_error()

    def _make_error(self) -> ExpressionError:
        token = self._token
        token_text = "the end of the text" if token.kind == "end" else repr(token.text)
        return ExpressionError(f"syntax error at character {token.offset + 1}: {token_text} is not expected there")


def _split_into_tokens(text: str) -> Iterator[Token]:
    offset = 0
    while offset < len(text):
        match = _TOKEN.match(text, offset)
        if match is None:
            raise ExpressionError(
                f"syntax error at character {offset + 1}: {text[offset]!r} is not part of an expression"
            )
        start, offset = offset, match.end()
        if match["string"]:
            value, offset = _read_quoted(text, match)
            yield Token("string", text[start:offset], start, value)
        elif match["float"]:
            yield Token("number", match[0], start, float(match["float"]))
        elif match["int"]:
            yield Token("number", match[0], start, _read_integer(match["int"], unsigned=bool(match["unsigned"])))
        elif match["name"] or match["operator"]:
            yield Token("name" if match["name"] else "operator", match[0], start)
    while True:
        yield Token("end", "", len(text))


def _read_integer(digits: str, *, unsigned: bool) -> int:
    value = int(digits, 16) if digits.startswith("0x") else int(digits)
    if not unsigned:
        return value  # 2**63 is allowed behind a minus, so the range is checked there
    if value not in UINT64:
        raise ExpressionError("invalid uint literal")
    return Unsigned(value)


def _read_number(token: Token) -> int | float:
    if not isinstance(token.value, int | float):
        raise TypeError(token)
    return token.value


def _read_quoted(text: str, match: re.Match[str]) -> tuple[str | bytes, int]:
    """The value of a string or bytes constant, and where it ends."""
    prefix, quote = match["prefix"].lower(), match["quoted"]
    start, raw = match.end(), "r" in prefix
    end = start
    while not text.startswith(quote, end):
        if end >= len(text) or (len(quote) == 1 and text[end] == "\n"):
            raise ExpressionError(f"syntax error at character {match.start() + 1}: the string is not closed")
        end += 2 if text[end] == "\\" and not raw else 1
    body = text[start:end]
    after = end + len(quote)
    if "b" in prefix:
        return (body if raw else _ESCAPE.sub(_unescape, body)).encode(), after
    return (body if raw else _ESCAPE.sub(_unescape, body)), after


def _unescape(match: re.Match[str]) -> str:
    if match["simple"]:
        return _SIMPLE.get(match["simple"], match["simple"])
    digits = match["x"] or match["u"] or match["w"]
    code = int(digits, 16) if digits else int(match["octal"], 8) if match["octal"] else -1
    if code < 0 or code > 0x10FFFF or 0xD800 <= code < 0xE000:
        raise ExpressionError(f"invalid escape sequence {match[0]!r} in a string")
    return chr(code)
