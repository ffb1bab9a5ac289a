"""CMakeLists.txt and *.cmake: packages, languages, linked libraries, executables, components. Never run, only read."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Final

from ros_profile.model.facts import Fact, Kind
from ros_profile.model.package import Executable, SourceFile
from ros_profile.read.text import decode

MAX_COMMANDS: Final = 5000
MAX_CALLS: Final = 8
"""How deep functions call each other."""
MAX_ROUNDS: Final = 100
_BLOCKS: Final = frozenset({"function", "macro", "foreach"})
MAX_VALUES: Final = 2000
"""Values a variable may grow to: `set(A ${A} ${A})` doubles with each line."""
_COMMENT = re.compile(r"#\[(?P<mark>=*)\[.*?\](?P=mark)\]|#[^\n]*", re.DOTALL)
_COMMAND = re.compile(r"^[ \t]*(\w{1,60})[ \t]*\(([^()]*(?:\([^()]*\)[^()]*){0,40}+)\)", re.MULTILINE)
_WORD = re.compile(r'"((?:\\.|[^"\\])*)"|([^\s"]+)')
_VARIABLE = re.compile(r"\$\{(\w{1,80})\}")
_TESTING = re.compile(r"BUILD_TESTING|ENABLE_TESTING|BUILD_TESTS?\b|_TESTS?\b|GTEST|BUILD_DOC", re.IGNORECASE)
_SOURCE = re.compile(r"\.(?:c|cc|cpp|cxx|cu|hpp|h)$")
_NOT_LIBRARY = frozenset(
    {"PUBLIC", "PRIVATE", "INTERFACE", "LINK_PUBLIC", "LINK_PRIVATE", "general", "optimized", "debug"}
)


@dataclass(frozen=True, slots=True)
class Command:
    name: str
    words: tuple[str, ...]
    line: int


@dataclass(frozen=True, slots=True)
class _Function:
    """A function or macro of the file: the names of its arguments, and what it does."""

    arguments: tuple[str, ...]
    body: tuple[Command, ...]


@dataclass(slots=True)
class _State:
    """What was set so far in one file."""

    file: str
    variables: dict[str, list[str]] = field(default_factory=dict)
    sources: dict[str, tuple[str, ...]] = field(default_factory=dict)
    conditions: list[str] = field(default_factory=list)
    facts: list[Fact] = field(default_factory=list)
    executables: list[Executable] = field(default_factory=list)
    functions: dict[str, "_Function"] = field(default_factory=dict)
    commands: int = 0
    """How many were read, those of functions and loops each time they run."""

    def add(self, subject: str, values: list[str], line: int, *, weight: float = 1.0) -> None:
        weight = min(weight, 0.5) if self.conditions else weight
        self.facts += [Fact(Kind.BUILD, subject, value, self.file, line, weight) for value in values]


def read_cmake(data: bytes, file: str) -> SourceFile:
    state = _State(file)
    _run(state, list(_commands(decode(data))), depth=0)
    return SourceFile(file, "cmake", tuple(state.facts), executables=tuple(state.executables))


def _run(state: _State, commands: list[Command], *, depth: int) -> None:
    """Reads commands in their order; functions, macros and loops as often as they are called."""
    index = 0
    while index < len(commands) and state.commands < MAX_COMMANDS:
        command, name = commands[index], commands[index].name
        index += 1
        state.commands += 1
        if name in _BLOCKS:
            body = _block(commands, index, name)
            index += len(body) + 1
            _begin_block(state, command, body, depth=depth)
        elif name == "if":
            state.conditions.append(" ".join(command.words))
        elif name in {"else", "elseif"} and state.conditions:
            state.conditions[-1] = "else"
        elif name == "endif" and state.conditions:
            state.conditions.pop()
        elif not any(_TESTING.search(condition) for condition in state.conditions):
            words = _expanded(command.words, state.variables)
            if name in state.functions:
                _call(state, name, words, depth=depth)
            else:
                _read(state, name, words, command.line)


def _block(commands: list[Command], start: int, name: str) -> list[Command]:
    """Returns what stands between a command that begins a block and the one that ends it."""
    level = 1
    for index in range(start, len(commands)):
        level += (commands[index].name == name) - (commands[index].name == f"end{name}")
        if level == 0:
            return commands[start:index]
    return commands[start:]


def _begin_block(state: _State, command: Command, body: list[Command], *, depth: int) -> None:
    if command.name in {"function", "macro"}:
        if command.words:
            state.functions[command.words[0].lower()] = _Function(command.words[1:], tuple(body))
        return
    words = _expanded(command.words, state.variables)
    if not words or depth >= MAX_CALLS:
        return
    variable, values = words[0], [word for word in words[1:] if word not in {"IN", "ITEMS"}]
    if "LISTS" in values:
        values = [v for name in values[values.index("LISTS") + 1 :] for v in state.variables.get(name, [])]
    for value in values[:MAX_ROUNDS]:
        state.variables[variable] = [value]
        _run(state, body, depth=depth + 1)


def _call(state: _State, name: str, words: list[str], *, depth: int) -> None:
    """Reads the body of a function with its arguments in place; what it sets stays, which is more than CMake keeps."""
    if depth >= MAX_CALLS:
        return
    function = state.functions[name]
    rest = words[len(function.arguments) :]
    given = dict(zip(function.arguments, ([word] for word in words), strict=False))
    given |= {"ARGN": rest, "ARGV": words} | {f"ARGV{index}": [word] for index, word in enumerate(words[:20])}
    outer = {key: state.variables.get(key) for key in given}
    state.variables.update(given)
    conditions, state.conditions = state.conditions, list(state.conditions)
    _run(state, list(function.body), depth=depth + 1)
    state.conditions = conditions
    for key, value in outer.items():
        if value is None:
            state.variables.pop(key, None)
        else:
            state.variables[key] = value


def _commands(text: str) -> Iterator[Command]:
    """Commands with their words, variables not yet replaced."""
    text = _COMMENT.sub(lambda match: "\n" * match.group().count("\n"), text)
    line, last = 1, 0
    for index, match in enumerate(_COMMAND.finditer(text)):
        if index >= MAX_COMMANDS:
            return
        line += text.count("\n", last, match.start(1))
        last = match.start(1)
        words = tuple(quoted or plain for quoted, plain in _WORD.findall(match.group(2)))
        yield Command(match.group(1).lower(), words, line)


def _expanded(words: tuple[str, ...], variables: dict[str, list[str]]) -> list[str]:
    found: list[str] = []
    for word in words:
        whole = _VARIABLE.fullmatch(word)
        if whole and whole.group(1) in variables:
            found += variables[whole.group(1)]
        else:
            found += _VARIABLE.sub(lambda m: (variables.get(m.group(1)) or [""])[0][:200], word).split(";")
        if len(found) > MAX_VALUES:
            break
    return found[:MAX_VALUES]


def _read(state: _State, name: str, words: list[str], line: int) -> None:
    if not words:
        return
    first, rest = words[0], words[1:]
    if name == "set":
        state.variables[first] = [w for w in rest if w not in {"CACHE", "PARENT_SCOPE"}]
    elif name == "list" and first == "APPEND" and rest:
        state.variables[rest[0]] = [*state.variables.get(rest[0], []), *rest[1:]][:MAX_VALUES]
    elif name == "project":
        state.variables["PROJECT_NAME"] = [first]
        state.add("language", [w for w in rest if w in {"CUDA", "HIP"}], line)
    elif name in {"enable_language", "check_language"}:
        state.add("language", [first], line, weight=1.0 if name == "enable_language" else 0.5)
    elif name in {"find_package", "pkg_check_modules", "pkg_search_module", "find_library"}:
        _find(state, name, first, rest, line)
    elif name in {"target_link_libraries", "link_libraries"}:
        state.add("link", [w for w in rest if w not in _NOT_LIBRARY and not w.startswith("$")], line)
    elif name in {"ament_target_dependencies", "ament_auto_find_build_dependencies"}:
        state.add("link", [w for w in rest if w not in _NOT_LIBRARY], line)
    else:
        _target(state, name, first, rest, line)


def _find(state: _State, name: str, first: str, rest: list[str], line: int) -> None:
    optional = (
        1.0 if name != "find_package" or "REQUIRED" in rest or not {"QUIET", "OPTIONAL_COMPONENTS"} & set(rest) else 0.5
    )
    if name == "find_package":
        state.add("find_package", [first], line, weight=optional)
        if "COMPONENTS" in rest:
            components = rest[rest.index("COMPONENTS") + 1 :]
            state.add("component", [w for w in components if not w.isupper() or w == "CUDA"], line, weight=optional)
        return
    state.add(
        name, [w for w in rest if w not in {"REQUIRED", "QUIET", "NAMES", "PATHS", "HINTS", "IMPORTED_TARGET"}], line
    )


def _target(state: _State, name: str, first: str, rest: list[str], line: int) -> None:
    if name in {
        "add_executable",
        "add_library",
        "cuda_add_executable",
        "cuda_add_library",
        "ament_auto_add_executable",
        "ament_auto_add_library",
    }:
        state.sources[first] = tuple(_inside(word, state.file) for word in rest if _SOURCE.search(word))
        if name.startswith("cuda"):
            state.add("language", ["CUDA"], line)
        if name.endswith("executable") and not _TESTING.search(first):
            state.executables.append(Executable(first, "program", state.sources[first], line=line, file=state.file))
    elif name == "rclcpp_components_register_node":
        options = dict(zip(rest[::2], rest[1::2], strict=False))
        _component(state, options.get("EXECUTABLE", first), options.get("PLUGIN", ""), first, line)
    elif name == "rclcpp_components_register_nodes":
        for plugin in rest:
            _component(state, plugin.rsplit("::", 1)[-1], plugin, first, line)
    elif name == "set_target_properties" and "OUTPUT_NAME" in rest[:-1]:
        called = rest[rest.index("OUTPUT_NAME") + 1]
        state.executables = [replace(e, name=called) if e.name == first else e for e in state.executables]
    elif name == "install" and first in {"PROGRAMS", "FILES"}:
        _programs(state, rest, line, only_scripts=first == "FILES")
    elif name == "catkin_install_python" and rest:
        _programs(state, rest, line, only_scripts=False)


def _component(state: _State, name: str, plugin: str, target: str, line: int) -> None:
    if plugin:
        state.executables.append(Executable(name, "component", state.sources.get(target, ()), plugin, line, state.file))


def _programs(state: _State, words: list[str], line: int, *, only_scripts: bool) -> None:
    for word in words:
        if word in {"DESTINATION", "RENAME", "PERMISSIONS", "COMPONENT"}:
            return
        name = word.rsplit("/", 1)[-1]
        if not word or (only_scripts and not name.endswith(".py")):
            continue
        if "." not in name or name.endswith((".py", ".sh")):
            state.executables.append(
                Executable(name, "script", (_inside(word, state.file),), line=line, file=state.file)
            )


def _inside(word: str, file: str) -> str:
    """A path of a build file relative to the package: `src/a.cpp` in `lib/CMakeLists.txt` is `lib/src/a.cpp`."""
    folder = file.rpartition("/")[0]
    word = re.sub(r"^\$\{\w*(?:SOURCE_DIR|LIST_DIR)\}/|^/|^\./", "", word)
    return f"{folder}/{word}" if folder else word
