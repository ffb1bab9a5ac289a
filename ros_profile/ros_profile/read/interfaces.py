"""Definitions of messages, services and actions."""

import re

from ros_profile.model.facts import Fact, Kind, Problem
from ros_profile.model.package import SourceFile
from ros_profile.read.text import decode

SUFFIXES = (".msg", ".srv", ".action")
_NAME = re.compile(r"^[A-Za-z]\w{0,100}$")
# Blanks, not \s: that would run over the line ends of empty lines, from each of them to the last.
_FIELD = re.compile(r"^[ \t]*([A-Za-z][\w/]{0,150})(?:<=\d+)?(?:\[(?:<=)?\d*\])?[ \t]+[a-zA-Z]\w*", re.MULTILINE)
_PARTS = {".msg": 1, ".srv": 2, ".action": 3}


def read_interface(data: bytes, file: str) -> SourceFile:
    """`msg/Name` with the types of its fields of other packages as value."""
    stem, dot, suffix = file.rpartition("/")[2].rpartition(".")
    suffix = dot + suffix
    if suffix not in SUFFIXES or not _NAME.match(stem):
        return SourceFile(file, "interface", problems=(Problem(file, "is no name of a message, service or action"),))
    text = re.sub(r"#[^\n]*", "", decode(data)[:200_000])
    parts = len(re.findall(r"^---[ \t]*$", text, re.MULTILINE)) + 1
    wanted = _PARTS[suffix]
    problems = () if parts == wanted else (Problem(file, f"has {parts} parts separated by ---; {suffix} has {wanted}"),)
    used = dict.fromkeys(name for name in _FIELD.findall(text) if "/" in name)
    fact = Fact(Kind.INTERFACE, f"{suffix[1:]}/{stem}", " ".join(list(used)[:50]), file)
    return SourceFile(file, "interface", (fact,), problems=problems)
