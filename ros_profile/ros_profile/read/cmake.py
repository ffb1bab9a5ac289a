"""CMakeLists.txt and *.cmake: packages, languages, linked libraries, executables, components. Never run, only read."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

from ros_profile.model.facts import Fact, Kind
from ros_profile.model.package import Executable, SourceFile
from ros_profile.read.text import decode

MAX_COMMANDS: Final = 5000
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


@dataclass(slots=True)
class _State:
    """What was set so far in one file."""

    file: str
    variables: dict[str, list[str]] = field(default_factory=dict)
    sources: dict[str, tuple[str, ...]] = field(default_factory=dict)
    conditions: list[str] = field(default_factory=list)
    facts: list[Fact] = field(default_factory=list)
    executables: list[Executable] = field(default_factory=list)

    def add(self, subject: str, values: list[str], line: int, *, weight: float = 1.0) -> None:
        weight = min(weight, 0.5) if self.conditions else weight
        self.facts += [Fact(Kind.BUILD, subject, value, self.file, line, weight) for value in values]


def read_cmake(data: bytes, file: str) -> SourceFile:
    state = _State(file)
    for command in _commands(decode(data)):
        name = command.name
        if name == "if":
            state.conditions.append(" ".join(command.words))
        elif name in {"else", "elseif"} and state.conditions:
            state.conditions[-1] = "else"
        elif name == "endif" and state.conditions:
            state.conditions.pop()
        elif not any(_TESTING.search(condition) for condition in state.conditions):
            _read(state, name, _expanded(command.words, state.variables), command.line)
    return SourceFile(file, "cmake", tuple(state.facts), executables=tuple(state.executables))


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
