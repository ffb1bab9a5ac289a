"""C++ sources: endpoints, timers, parameters, library names, plug-ins, nodes.

A file is read as text without comments; classes around a place come from tree-sitter when it can parse the file within its
budget. Nothing here depends on a file that parses: a quarter of public ROS sources hold macros tree-sitter cannot read.
"""

import re
from collections.abc import Iterator

from ros_profile.model.facts import Fact, Kind
from ros_profile.model.package import Executable, SourceFile
from ros_profile.read.cpp.endpoints import Context, context, endpoints, timers
from ros_profile.read.cpp.symbols import facts, nodes
from ros_profile.read.cpp.text import source
from ros_profile.read.cpp.tree import Tree
from ros_profile.read.cpp.variables import declared

SUFFIXES = (".cpp", ".cc", ".cxx", ".c", ".hpp", ".hh", ".hxx", ".h", ".cu", ".cuh", ".inl", ".ipp", ".tpp")
_TELLING = re.compile(r"::(?:msg|srv|action)::|^\w+::[A-Z]\w+")


def read_cpp(data: bytes, file: str) -> SourceFile:
    tree = Tree(source(data))
    c = context(tree, file)
    named = nodes(tree, file)
    found = [*facts(tree, file, c.aliases), *named, *_aliases(c)]
    if file.endswith((".cu", ".cuh")):
        found.append(Fact(Kind.BUILD, "language", "CUDA", file))
    return SourceFile(
        file,
        "cpp",
        tuple(found),
        tuple(endpoints(c)),
        tuple(timers(c)),
        tuple(declared(tree, file)),
        tuple(dict.fromkeys(fact.value for fact in named)),
        tuple(dict.fromkeys(fact.subject for fact in found if fact.kind is Kind.INCLUDE)),
        tuple(_loadable(found)),
    )


def _loadable(found: list[Fact]) -> Iterator[Executable]:
    """Components, nodelets and other plug-ins whose class is registered in this file."""
    components = {fact.subject: fact for fact in found if fact.kind is Kind.COMPONENT}
    for name, fact in components.items():
        yield Executable(name.rsplit("::", 1)[-1], "component", (fact.file,), name, fact.line, fact.file)
    for fact in found:
        if fact.kind is Kind.PLUGIN_BASE and fact.value not in components:
            yield Executable(fact.value.rsplit("::", 1)[-1], "plugin", (fact.file,), fact.value, fact.line, fact.file)


def _aliases(c: Context) -> list[Fact]:
    """What other files of the package need to name their types: aliases, callbacks (`&name`) and members (`.name`)."""
    pairs = [
        *c.aliases.items(),
        *((f"&{name}", value) for name, value in c.callbacks.items()),
        *((f".{name}", value) for name, value in c.stored.items()),
    ]
    return [Fact(Kind.ALIAS, name, value, c.file) for name, value in pairs if _TELLING.search(value)]
