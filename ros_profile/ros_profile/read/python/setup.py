"""setup.py and setup.cfg: the executables a Python package installs."""

import ast
import configparser
import re
from collections.abc import Iterator
from typing import Final

from ros_profile.model.facts import Problem
from ros_profile.model.package import Executable, SourceFile
from ros_profile.read.python.syntax import parse, walk
from ros_profile.read.text import decode

_ENTRY: Final = re.compile(r"\s*([\w.-]{1,100})\s*=\s*([\w.]{1,200})\s*(?::\s*[\w.]+)?\s*(?:\[.*\])?\s*")


def read_setup_py(data: bytes, file: str) -> SourceFile:
    """`console_scripts` and `scripts` of a setup call that is read, never run."""
    module, problems = parse(data, file)
    if module is None:
        return SourceFile(file, "setup", problems=problems)
    found: list[Executable] = []
    for node, _, _ in walk(module):
        if isinstance(node, ast.Dict):
            for key, value in zip(node.keys, node.values, strict=True):
                if isinstance(key, ast.Constant) and key.value == "console_scripts":
                    found += _entries(value, file)
        elif isinstance(node, ast.keyword) and node.arg == "scripts":
            found += _scripts(node.value, file)
    return SourceFile(file, "setup", executables=tuple(found), problems=problems)


def _texts(node: ast.AST) -> Iterator[tuple[str, int]]:
    for child in ast.walk(node):
        if isinstance(child, ast.Constant) and isinstance(child.value, str):
            yield child.value, child.lineno


def _entries(node: ast.AST, file: str) -> Iterator[Executable]:
    for text, line in _texts(node):
        for part in text.splitlines():
            yield from _entry(part, file, line)


def _entry(text: str, file: str, line: int) -> Iterator[Executable]:
    if match := _ENTRY.fullmatch(text):
        module = match[2].replace(".", "/")
        yield Executable(match[1], "script", (f"{module}.py",), line=line, file=file)


def _scripts(node: ast.AST, file: str) -> Iterator[Executable]:
    for text, line in _texts(node):
        if text and ".." not in text:
            yield Executable(text.rpartition("/")[2], "script", (text,), line=line, file=file)


def read_setup_cfg(data: bytes, file: str) -> SourceFile:
    """`[options.entry_points] console_scripts`."""
    text = decode(data)
    reader = configparser.ConfigParser(interpolation=None, strict=False)
    try:
        reader.read_string(text)
        listed = reader.get("options.entry_points", "console_scripts", fallback="")
    except configparser.Error as error:
        return SourceFile(
            file, "setup", problems=(Problem(file, f"is no setup.cfg: {str(error).splitlines()[0][:200]}"),)
        )
    found = [entry for part in listed.splitlines() for entry in _entry(part, file, 0)]
    return SourceFile(file, "setup", executables=tuple(found))
