"""Text to a syntax tree, Python 2 as far as it goes."""

import ast
import re
import warnings
from collections.abc import Iterator
from typing import Final

from ros_profile.model.facts import Problem
from ros_profile.read.text import MAX_LINE, decode, printable

MAX_NODES: Final = 300_000
MAX_LEFT_OUT: Final = 20
"""Lines of one file that may be left out because they are no Python 3: each costs a parse of the file."""
MAX_MENDED: Final = 100_000
"""Characters of a file that is parsed again and again."""
MAX_BITS: Final = 64
"""Of a number: Python writes no number of more than some thousand digits, and no parameter has one."""

Walked = tuple[ast.AST, str, str]
"""A node with the class and the function it stands in."""
_PRINT: Final = re.compile(
    r"^([ \t]*(?:(?:else|try|finally)\s*:\s*)?)print\b(?!\s*\().*$|^([ \t]*)print\s*>>.*$", re.MULTILINE
)
_EXCEPT: Final = re.compile(r"^([ \t]*except\s+[\w.()]+(?:\s*,\s*[\w.]+\s*\))?)\s*,\s*\w+\s*:", re.MULTILINE)
_RAISE: Final = re.compile(r"^([ \t]*)raise\s+\w+\s*,.*$", re.MULTILINE)
_EXEC: Final = re.compile(r"^([ \t]*)exec\s+[^(\s].*$", re.MULTILINE)
_LITERALS: Final = re.compile(r"(?<![\w.])0([0-7]+)\b(?!\.)|\b(\d+)L\b|\bur(['\"])")
_FAILURES: Final = (SyntaxError, ValueError, RecursionError, MemoryError)


def parse(data: bytes, file: str) -> tuple[ast.Module | None, tuple[Problem, ...]]:
    """The module, or None with the reason."""
    text = decode(data)
    if len(text) > MAX_LINE and any(len(line) > MAX_LINE for line in text.split("\n")):
        return None, (Problem(file, f"has lines longer than {MAX_LINE} characters: taken for data"),)
    try:
        return _parse(text), ()
    except _FAILURES as error:
        first = error
    line = getattr(first, "lineno", 0) or 0
    module, left_out = _parse_in_part(_python3(text))
    if module is None:
        return None, (Problem(file, f"is not Python: {str(first)[:200]}", line),)
    return module, tuple(Problem(file, "this line is no Python 3 and is left out", number) for number in left_out)


def _parse_in_part(text: str) -> tuple[ast.Module | None, list[int]]:
    """Parses a text without the lines that are no Python 3, at most MAX_LEFT_OUT; one such line hides no whole program."""
    lines = text.split("\n")
    left_out: list[int] = []
    while True:
        try:
            return _parse("\n".join(lines)), left_out
        except SyntaxError as error:
            number = error.lineno or 0
            is_cheap = len(left_out) < MAX_LEFT_OUT and len(text) <= MAX_MENDED
            if not is_cheap or number in left_out or not 0 < number <= len(lines):
                return None, []
            line = lines[number - 1]
            opens = "if True:" if line.rstrip().endswith(":") else "pass"
            lines[number - 1] = line[: len(line) - len(line.lstrip())] + opens
            left_out.append(number)
        except _FAILURES:
            return None, []


def _parse(text: str) -> ast.Module:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # "\d" in plain strings of foreign source
        # Without a file name Python looks for a wrong line in the file `<unknown>` of the current directory.
        module = ast.parse(text.expandtabs(8) if "\t" in text else text, filename="")
    if "\\u" in text.lower():
        for node in ast.walk(module):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                node.value = printable(node.value)
    return module


def _python3(text: str) -> str:
    """Statements that only Python 2 has are made ones of Python 3, line by line, so that lines stay where they are."""
    text = _PRINT.sub(lambda match: f"{match[1] or match[2] or ''}pass", text)
    text = _EXCEPT.sub(r"\1:", text)
    text = _RAISE.sub(r"\1raise", text)
    text = _EXEC.sub(r"\1pass", text)
    text = _LITERALS.sub(lambda m: f"0o{m[1]}" if m[1] else m[2] or m[3] or "", text)
    return text.replace("<>", "!=").replace("`", "'")


def walk(root: ast.AST) -> Iterator[Walked]:
    """Every node with the class and the function it stands in, in the order of the text; without recursion."""
    waiting: list[tuple[ast.AST, str, str]] = [(root, "", "")]
    count = 0
    while waiting and count < MAX_NODES:
        node, owner, function = waiting.pop()
        count += 1
        yield node, owner, function
        if isinstance(node, ast.ClassDef):
            owner, function = node.name, ""
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            function = node.name
        children = list(ast.iter_child_nodes(node))
        waiting += [(child, owner, function) for child in reversed(children)]


def dotted(node: ast.AST) -> str:
    """`a.b.c` of a chain of names; empty for anything else."""
    parts: list[str] = []
    while isinstance(node, ast.Attribute) and len(parts) < 20:
        parts.append(node.attr)
        node = node.value
    if not isinstance(node, ast.Name):
        return ""
    return ".".join([node.id, *reversed(parts)])
