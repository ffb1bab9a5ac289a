"""Calls, classes and owners in C++: by tree-sitter where it can parse within its budget, by brackets where not."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import tree_sitter
import tree_sitter_cpp

from ros_profile.read.cpp.text import Source, balanced, split_arguments

LARGEST_BYTES = 256 * 1024
NEAR_CHARACTERS = 30_000
MOST_CALLS = 400
"""Of one kind in one file: more are generated."""
MOST_UNCLOSED = 50
"""Calls whose brackets do not close, after which a file is no C++ worth the time."""
_PROGRESS_PER_BYTE = 0.02
"""The densest file of 2,366 public ones needed 0.014 progress reports per byte: more means that the parser is stuck."""

_LANGUAGE = tree_sitter.Language(tree_sitter_cpp.language())
_CLASS = re.compile(
    r"\b(?:class|struct)\s+(?:[A-Z_]+\s+)?(?P<name>\w+)\s*(?:final\s*)?:(?!:)(?P<bases>[^;{}]{1,800}+)\{"
)
_BASE = re.compile(r"\b(?:public|private|protected|virtual)\b")


@dataclass(frozen=True, slots=True)
class Call:
    """`name<template>(arguments)` with the class whose code it stands in, as far as that can be told."""

    name: str
    template: str
    arguments: tuple[str, ...]
    place: int
    owner: str
    receiver: str
    """What the function is called on or the variable that is constructed: `it_`, `nh`, `loop_rate`."""


class Tree:
    """A file as text and syntax tree. `root` is None when parsing was given up: then the text alone has to do."""

    def __init__(self, source: Source) -> None:
        self.source = source
        self._root: tree_sitter.Node | None = None
        self._parsed = False
        self._unclosed = 0

    @property
    def root(self) -> tree_sitter.Node | None:
        """Parsed when first needed: most files hold nothing whose class matters."""
        if not self._parsed:
            self._parsed = True
            data = self.source.code.encode("utf-8", "replace")
            self._root = _parse(data) if len(data) == len(self.source.code) else None
        return self._root

    def calls(self, names: re.Pattern[str]) -> Iterator[Call]:
        """Every place of one of these names that is followed by arguments, in the order of the file."""
        code = self.source.code
        for match in islice(names.finditer(code), MOST_CALLS):
            if self._unclosed > MOST_UNCLOSED:
                return
            call = self._call(match.group("name"), match.start("name"), match.end("name"))
            if call is not None:
                yield call

    def _call(self, name: str, start: int, end: int) -> Call | None:
        code = self.source.code
        place, template = _spaces(code, end), ""
        if code.startswith("<", place):
            after = balanced(code, place, close=">")
            if after < 0:
                self._unclosed += 1
                return None
            template, place = code[place + 1 : after - 1], _spaces(code, after)
        variable = re.compile(r"[A-Za-z_]\w{0,80}").match(code, place)
        if variable:
            place = _spaces(code, variable.end())
        if not code.startswith(("(", "{"), place):
            return None
        after = balanced(code, place, close=")" if code[place] == "(" else "}")
        if after < 0:
            self._unclosed += 1
            return None
        arguments = tuple(split_arguments(code[place + 1 : after - 1]))
        receiver = variable.group() if variable else _receiver(code, start)
        return Call(name, template, arguments, start, self.owner(start), receiver)

    def near(self, place: int) -> str:
        """The code around a place, where what a name stands for is looked up: a whole file of usual length."""
        return self.source.code[max(0, place - NEAR_CHARACTERS) : place + NEAR_CHARACTERS]

    def owner(self, place: int) -> str:
        """The class in whose definition or member function the place stands."""
        if self.root is None:
            return _owner_by_text(self.source.code, place)
        node: tree_sitter.Node | None = self.root.descendant_for_byte_range(place, place + 1)
        while node is not None:
            if node.type == "function_definition":
                scope = _scope(node)
                if scope:
                    return scope
            elif node.type in {"class_specifier", "struct_specifier"}:
                name = node.child_by_field_name("name")
                return _text(name).rsplit("::", 1)[-1].split("<", 1)[0] if name else ""
            node = node.parent
        return ""

    def bases(self) -> Iterator[tuple[str, str, int]]:
        """(class, base class as written, place) of every inheritance."""
        for match in _CLASS.finditer(self.source.code):
            for base in split_arguments(match.group("bases")):
                name = _BASE.sub("", base).strip()
                if name:
                    yield match.group("name"), re.sub(r"\s+", "", name), match.start("name")


def _parse(data: bytes) -> tree_sitter.Node | None:
    if len(data) > LARGEST_BYTES:
        return None
    reports, limit = 0, 200 + int(len(data) * _PROGRESS_PER_BYTE)

    def too_long(_offset: int, _failed: bool = False) -> bool:
        nonlocal reports
        reports += 1
        return reports > limit

    def chunk(offset: int, _point: object) -> bytes:
        return data[offset : offset + 65536]

    try:
        return tree_sitter.Parser(_LANGUAGE).parse(chunk, progress_callback=too_long).root_node
    except ValueError:
        return None


def _text(node: tree_sitter.Node) -> str:
    return (node.text or b"").decode("utf-8", "replace")


def _scope(function: tree_sitter.Node) -> str:
    """`Driver` of `void Driver::run(…)`."""
    node = function.child_by_field_name("declarator")
    while node is not None and node.type != "qualified_identifier":
        inner = node.child_by_field_name("declarator")
        node = inner if inner is not None else next((c for c in node.children if c.type.endswith("declarator")), None)
    scopes: list[str] = []
    while node is not None and node.type == "qualified_identifier":
        scope = node.child_by_field_name("scope")
        if scope is not None:
            scopes.append(_text(scope).split("<", 1)[0])
        node = node.child_by_field_name("name")
    return scopes[-1] if scopes else ""


_MEMBER = re.compile(r"^[\w:<>,&*~\s]{0,300}?\b(\w+)(?:<[^<>\n]{0,100}>)?::~?\w+\s*\(", re.MULTILINE)


def _owner_by_text(code: str, place: int) -> str:
    """The last member function that begins in column one before the place."""
    begin = max(0, place - 20_000)
    owner = ""
    for line in code[begin:place].split("\n"):
        if line[:1].isalpha() and "::" in line and (match := _MEMBER.match(line[:400])):
            owner = match.group(1)
    return owner


def _spaces(code: str, place: int) -> int:
    while place < len(code) and code[place] in " \t\n":
        place += 1
    return place


def _receiver(code: str, start: int) -> str:
    match = re.search(r"(\w+)\s*(?:\.|->|::)\s*(?:template\s+)?\Z", code[max(0, start - 120) : start])
    return match.group(1) if match else ""
