"""Rigel 0.2's templates: `{{ name }}` from the file's vars, then from the environment. Anything else stays as it is.

Only text that the RobotApp needs is rendered, so an unset registry password is no error.

Rigelfiles come from foreign repositories, so what a file can read and cost is bounded: of the environment it reads the
variables that the user named, and all of its texts together stay within the bounds below.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final

from rigel_bridge.document.failures import control_character, nearest
from rigel_bridge.document.tree import Node

MAX_VALUE: Final = 4096
"""Characters of one value that stands for a name."""
MAX_NESTED: Final = 16
MAX_REPLACED: Final = 10_000
MAX_EXPANDED: Final = 256 * 1024
"""Characters that all names of a file together stand for: as much as the file itself may have."""
MAX_STEPS: Final = 20_000_000
"""Characters that all patterns of a file may look at, at worst: about half a second."""
# Rigel looks for these characters and then drops all blanks and braces from the name.
_MARK: Final = re.compile(r"\{\{([a-zA-Z0-9_\s\-!?]+)\}\}")
SECRETS: Final = "the bridge takes no secrets"
_SECRET: Final = re.compile(
    r"(PASSW(OR)?D|PASSPHRASE|SECRET|TOKEN|CREDENTIAL|PRIVATE_?KEY|ACCESS_?KEY|API_?KEY)S?(?=$|[_-])", re.IGNORECASE
)
"""At the end of a word: TOKENIZERS_PARALLELISM is none."""
_DROPPED: Final = re.compile(r"[{} ]")


@dataclass(slots=True)
class Spent:
    """What a file has used of its bounds so far."""

    replaced: int = 0
    characters: int = 0
    steps: int = 0

    def one_more(self, node: Node) -> None:
        """Counted before the work is done: names that stand for nothing cost time as well."""
        self.replaced += 1
        if self.replaced > MAX_REPLACED:
            raise node.fail(f"the file has more than {MAX_REPLACED} replaced names, counting those inside vars")

    def search(self, node: Node, steps: int) -> None:
        """Counted before a pattern is searched."""
        self.steps += steps
        if self.steps > MAX_STEPS:
            raise node.fail("the file has too many regex_replace, or too long ones: write the values out")

    def add(self, node: Node, value: str) -> str:
        self.characters += len(value)
        if self.characters > MAX_EXPANDED:
            raise node.fail(f"the names of the file stand for more than {MAX_EXPANDED // 1024} KiB of text")
        return value


@dataclass(frozen=True, slots=True)
class Templates:
    """Where names are looked up. `environment` holds the variables that the user named, and no others."""

    variables: Mapping[str, Node] = field(default_factory=dict)
    environment: Mapping[str, str] = field(default_factory=dict)
    reads_environment: bool = True
    """False for the drafts between 0.2 and 0.3, which looked into vars alone."""
    spent: Spent = field(default_factory=Spent)

    def resolve(self, node: Node) -> Node:
        """The node with its marks replaced: text stays text."""
        return replace(node, value=self.render(node, node.value)) if isinstance(node.value, str) else node

    def render(self, node: Node, text: str, *, inside: tuple[str, ...] = ()) -> str:
        """`text` of `node` with its marks replaced; an unknown name is an error. `inside`: the vars being rendered."""
        return _MARK.sub(lambda match: self._value(node, _DROPPED.sub("", match[1]), inside), text)

    def _value(self, node: Node, name: str, inside: tuple[str, ...]) -> str:
        self.spent.one_more(node)
        if name in inside:
            raise node.fail(f"{{{{ {name} }}}} stands for itself: {' -> '.join((*inside, name))}")
        if len(inside) >= MAX_NESTED:
            raise node.fail(f"vars stand for one another more than {MAX_NESTED} deep; write the value out")
        if name in self.variables:
            value = self.render(self.variables[name], self._variable(node, name), inside=(*inside, name))
        elif name in self.environment:
            value = environment_value(node, name, self.environment)
        else:
            hint = nearest(name, sorted(self.variables))
            raise node.fail(f"{{{{ {name} }}}} is not in vars{hint}{self._cure(name)}")
        return self.spent.add(node, value)

    def _variable(self, node: Node, name: str) -> str:
        """The text of a var before its own marks are replaced, checked where it stands."""
        variable = self.variables[name]
        if not isinstance(variable.value, str):
            raise variable.fail(
                f"must be text for {{{{ {name} }}}} in {node.path}, found {variable.described()}; put it in quotes"
            )
        if problem := unfit(variable.value, allowed="\n\t"):
            raise variable.fail(problem)
        return variable.value

    def _cure(self, name: str) -> str:
        return cure(name) if self.reads_environment else ""


def cure(name: str) -> str:
    """What to do about a name that is not in vars."""
    if is_secret(name):
        return f"; Rigel takes it from the environment, {SECRETS}"
    return f"; --env {name} takes it from the environment"


def is_secret(name: str) -> bool:
    """Whether a variable's name looks as if its value were to be kept from others."""
    return bool(_SECRET.search(name))


def environment_value(node: Node, name: str, environment: Mapping[str, str]) -> str:
    """A variable that the user named, checked before it is used. What looks like a secret is refused: apps are not secret."""
    if is_secret(name):
        raise node.fail(
            f"{name} looks like a secret, and a RobotApp can be read by many: keep it in a Secret, "
            "and name that with envFrom or valueFrom of the component"
        )
    value = environment[name]
    if problem := unfit(value):
        raise node.fail(f"environment variable {name} {problem}")
    return value


def unfit(value: str, *, allowed: str = "") -> str:
    """Why a value cannot stand for a name; empty when it can."""
    if len(value) > MAX_VALUE:
        return f"has {len(value)} characters; allowed: {MAX_VALUE}"
    if found := control_character(value, allowed=allowed):
        return f"holds a character that is not printed (U+{ord(found):04X}); write plain text"
    return ""
