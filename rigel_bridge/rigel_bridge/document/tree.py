"""A YAML file as a tree that remembers its lines, read within bounds.

Rigelfiles come from foreign repositories. Size, depth, aliases and tags are checked on the event stream, before
anything is built: a file of 300 bytes can stand for millions of nodes through aliases.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import yaml

from rigel_bridge.document.failures import BridgeError, Exit, Place

MAX_BYTES: Final = 256 * 1024
MAX_DEPTH: Final = 32
MAX_DIGITS: Final = 100
"""Of a number; a longer one is text."""
_SHOWN: Final = 80
"""Characters of a value in a message."""
_LOADER: Final[type] = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_TAG = "tag:yaml.org,2002:"
_SCALARS = {f"{_TAG}{name}" for name in ("str", "int", "float", "bool", "null", "timestamp")}
_LISTS = {f"{_TAG}seq", f"{_TAG}python/tuple"}
"""Ports and volumes of Rigel's compose plugin are written as tuples."""
_WORDS = {
    "bool": "true or false",
    "int": "a number",
    "float": "a number",
    "null": "nothing",
    "map": "a mapping",
    "seq": "a list",
}

Scalar = str | int | float | bool | None


@dataclass(frozen=True, slots=True)
class Node:
    """A value and its place. `raw` is a scalar as it was typed; `path` is written as in messages: deploy[0].kwargs."""

    value: "Scalar | list[Node] | dict[str, Node]"
    place: Place
    path: str
    kind: str
    """str, int, float, bool, null, map or seq."""
    raw: str = ""

    def fail(self, message: str, *, code: Exit = Exit.INVALID, meant: str = "") -> BridgeError:
        text = f"{self.path}: {message}" if self.path else message
        return BridgeError(self.place, text, code=code, path=self.path, meant=meant)

    def described(self) -> str:
        """What the user wrote, for messages."""
        word = _WORDS.get(self.kind, "text")
        shown = self.raw if len(self.raw) <= _SHOWN else f"{self.raw[:_SHOWN]}…"
        return f"{word} ({shown})" if shown and self.kind not in ("map", "seq") else word

    def mapping(self) -> "dict[str, Node]":
        if not isinstance(self.value, dict):
            raise self.fail(f"expected a mapping, found {self.described()}")
        return self.value

    def sequence(self) -> "list[Node]":
        if not isinstance(self.value, list):
            raise self.fail(f"expected a list, found {self.described()}")
        return self.value


def mended(node: Node, error: BridgeError) -> Node:
    """The tree as it is when the error is mended: the key is the one that was meant, or what it is about is left out."""
    if isinstance(node.value, list):
        return replace(node, value=[mended(one, error) for one in node.value if one.path != error.path])
    if not isinstance(node.value, dict):
        return node
    entries = {}
    for key, one in node.value.items():
        if one.path != error.path:
            entries[key] = mended(one, error)
        elif error.meant and error.meant not in node.value:
            entries[error.meant] = one
    return replace(node, value=entries)


def is_within(path: str, outer: str) -> bool:
    """Whether a path is this one or leads below it."""
    return path == outer or not outer or path.startswith((f"{outer}.", f"{outer}["))


def parse(data: bytes, name: str) -> Node:
    """The tree of a document given as bytes; `name` stands for the file in messages."""
    place = Place(name)
    if len(data) > MAX_BYTES:
        raise BridgeError(place, f"is larger than {MAX_BYTES // 1024} KiB", code=Exit.UNREADABLE)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        raise BridgeError(Place(name, line), "is not UTF-8 text", code=Exit.UNREADABLE) from error
    try:
        _check_events(text, name)
        root = yaml.compose(text, Loader=_LOADER)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = mark.line + 1 if mark else 0
        raise BridgeError(Place(name, line), _not_yaml(error, text, line), code=Exit.SYNTAX) from error
    except yaml.reader.ReaderError as error:
        line = text[: error.position].count("\n") + 1 if isinstance(error.position, int) else 0
        raise BridgeError(
            Place(name, line), "holds a control character: a Rigelfile is plain text", code=Exit.SYNTAX
        ) from error
    except (yaml.YAMLError, ValueError) as error:  # ValueError: a code point beyond Unicode in an escape
        raise BridgeError(place, f"is not YAML: {error}", code=Exit.SYNTAX) from error
    if root is None:
        raise BridgeError(
            place,
            "is empty; a Rigelfile has packages, or application and jobs (docs/rigel-bridge.md)",
            code=Exit.SYNTAX,
        )
    return _convert(root, name, "")


def _not_yaml(error: yaml.MarkedYAMLError, text: str, line: int) -> str:
    """The parser's words, and the slip behind them where it is one of the usual."""
    problem = f"is not YAML: {error.problem or error.context or 'no reason given'}"
    written = "".join(text.splitlines()[line - 1 : line]) if line else ""
    if "\t" in written[: len(written) - len(written.lstrip())]:
        return f"{problem}; the line is indented with a tab: YAML takes spaces only"
    if "{{" in written:
        return f'{problem}; put a value that begins with {{{{ in quotes: "{{{{ name }}}}"'
    if "mapping values are not allowed" in problem:
        return f'{problem}; put a value that holds ": " in quotes, or look for a line above that is indented otherwise'
    if "did not find expected" in problem:
        return f"{problem}; look at the indentation and the brackets of the lines above"
    return problem


def _check_events(text: str, name: str) -> None:
    depth = documents = 0
    for event in _events(text):
        place = Place(name, event.start_mark.line + 1 if event.start_mark else 0)
        if isinstance(event, yaml.AliasEvent):
            raise BridgeError(place, f"alias *{event.anchor} is not allowed: write the value out", code=Exit.SYNTAX)
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
            if depth > MAX_DEPTH:
                raise BridgeError(place, f"is nested deeper than {MAX_DEPTH} levels", code=Exit.SYNTAX)
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        elif isinstance(event, yaml.DocumentStartEvent):
            documents += 1
            if documents > 1:
                raise BridgeError(place, "holds a second document: a Rigelfile is one", code=Exit.SYNTAX)


def _events(text: str) -> Iterator[yaml.Event]:
    yield from yaml.parse(text, Loader=_LOADER)


def _convert(node: yaml.Node, name: str, path: str, place: Place | None = None) -> Node:
    """`place` is that of the key, where there is one: a mapping below it begins a line later."""
    place = place or Place(name, node.start_mark.line + 1)
    if isinstance(node, yaml.MappingNode) and node.tag == f"{_TAG}map":
        return Node(_convert_mapping(node, name, path), place, path, "map")
    if isinstance(node, yaml.SequenceNode) and node.tag in _LISTS:
        items = [_convert(item, name, f"{path}[{index}]") for index, item in enumerate(node.value)]
        return Node(items, place, path, "seq")
    if isinstance(node, yaml.ScalarNode) and node.tag in _SCALARS:
        kind = node.tag.removeprefix(_TAG)
        value = _scalar(node, kind)
        return Node(value, place, path, "str" if isinstance(value, str) else kind, raw=node.value)
    raise BridgeError(
        place, f"{path or 'the document'}: tag {node.tag.replace(_TAG, '!!')} is not allowed", code=Exit.SYNTAX
    )


def _convert_mapping(node: yaml.MappingNode, name: str, path: str) -> dict[str, Node]:
    converted: dict[str, Node] = {}
    for key_node, value_node in node.value:
        place = Place(name, key_node.start_mark.line + 1)
        key = key_node.value
        if not isinstance(key_node, yaml.ScalarNode) or key_node.tag == f"{_TAG}merge":
            raise BridgeError(place, _no_key(node, path), code=Exit.SYNTAX)
        if key in converted:
            raise BridgeError(place, f"{path}.{key}".lstrip(".") + ": the key is there twice", code=Exit.SYNTAX)
        converted[key] = _convert(value_node, name, f"{path}.{key}" if path else key, place)
    return converted


def _no_key(node: yaml.MappingNode, path: str) -> str:
    """`load: {{ flag }}` without quotes is a mapping in a mapping to YAML."""
    where = path or "the document"
    if node.flow_style and any(isinstance(key, yaml.MappingNode) for key, _ in node.value):
        return f'{where}: a value that begins with {{{{ needs quotes: "{{{{ name }}}}"'
    return f"{where}: keys are plain words"


def _scalar(node: yaml.ScalarNode, kind: str) -> Scalar:
    text: str = node.value
    plain = text.replace("_", "")
    if kind == "null":
        return None
    if kind == "bool":
        return text.lower() in ("yes", "true", "on")
    try:
        if kind == "int":
            # Python writes no number of more than 4300 digits, and no field holds one of more than 64 bits.
            return int(plain, 0) if len(plain) <= MAX_DIGITS else text
        if kind == "float":
            return float(plain)
    except ValueError:  # 1:30 would be 90 to YAML 1.1, 0755 would be octal: keep what was typed
        return text
    return text
