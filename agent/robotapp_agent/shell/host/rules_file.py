"""The admin's file of rules for devices: read when it changes; while it is wrong, the rules before it stay."""

import os
import stat
from pathlib import Path

from robotapp_agent.devices.rules import LONGEST_FILE, Rules, Trouble, rules_of


class RulesFile:
    """One YAML file. It may be a link: the key of a mounted ConfigMap is one, exchanged as a whole."""

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._text = ""
        self.rules = Rules()
        self.problem = ""
        """What is wrong with the file as it is now, for log and status."""

    def __repr__(self) -> str:
        return f"RulesFile({self._path}, {len(self.rules.devices)} rules, {self.problem!r})"

    def refresh(self) -> Rules:
        """The rules to go by. A file that is not there holds none."""
        if self._path is None:
            return self.rules
        try:
            text = _text(self._path)
        except (OSError, UnicodeDecodeError, ValueError) as error:
            self._text, self.problem = "", f"{self._path}: {error}"
            return self.rules
        if text != self._text:
            self._text = text
            found, self.problem = rules_of_text(text, name=str(self._path))
            self.rules = self.rules if found is None else found
        elif not text:
            self.rules, self.problem = Rules(), ""
        return self.rules


def rules_of_text(text: str, *, name: str) -> tuple[Rules | None, str]:
    """The rules of a file's text, or None and a message with the line that is wrong."""
    if not text.strip():
        return Rules(), ""
    import yaml  # a robot without rules saves the memory

    from robotapp_api.values import strict_yaml

    try:
        found = rules_of(strict_yaml.loads(text))
    except yaml.YAMLError as error:
        return None, f"{name}: {error}"
    if isinstance(found, Trouble):
        return None, f"{name}, line {_line(yaml.compose(text, strict_yaml.StrictLoader), found.place)}: {_shown(found)}"
    return found, ""


def _shown(trouble: Trouble) -> str:
    where = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in trouble.place).removeprefix(".")
    return f"{where}: {trouble.message}" if where else trouble.message


def _line(node: object, place: tuple[str | int, ...]) -> int:
    """The line of a value, or of the innermost one around it that is there."""
    import yaml

    found = node
    for part in place:
        inner: object = None
        if isinstance(found, yaml.MappingNode):
            inner = next((value for key, value in found.value if key.value == part), None)
        elif isinstance(found, yaml.SequenceNode) and isinstance(part, int) and part < len(found.value):
            inner = found.value[part]
        if inner is None:
            break
        found = inner
    return found.start_mark.line + 1 if isinstance(found, yaml.Node) else 1


def _text(path: Path) -> str:
    """Of a plain file, whole; "" when there is none. Nothing else is opened: a pipe would keep the scan for ever."""
    try:
        fd = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOCTTY)
    except FileNotFoundError:
        return ""
    with os.fdopen(fd, "rb") as file:
        if not stat.S_ISREG(os.fstat(fd).st_mode):
            raise ValueError("no plain file")
        data = file.read(LONGEST_FILE + 1)
    if len(data) > LONGEST_FILE:
        raise ValueError(f"larger than {LONGEST_FILE} bytes")
    return data.decode()
