"""Rigel 0.2's templates: `{{ name }}` from the file's vars, then from the environment. Anything else stays as it is.

Only text that the RobotApp needs is rendered, so an unset registry password does not stop anybody.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from rigel_bridge.document import Node
from rigel_bridge.failures import nearest

# Rigel looks for these characters and then drops all blanks and braces from the name.
_MARK: Final = re.compile(r"\{\{([a-zA-Z0-9_\s\-!?]+)\}\}")
_DROPPED: Final = re.compile(r"[{} ]")


@dataclass(frozen=True, slots=True)
class Templates:
    """Where names are looked up. `environment` is empty when the user asked not to use it."""

    variables: Mapping[str, Node] = field(default_factory=dict)
    environment: Mapping[str, str] = field(default_factory=dict)

    def render(self, node: Node, text: str, *, inside: tuple[str, ...] = ()) -> str:
        """`text` of `node` with its marks replaced; an unknown name is an error. `inside`: the vars being rendered."""
        return _MARK.sub(lambda match: self._value(node, _DROPPED.sub("", match[1]), inside), text)

    def _value(self, node: Node, name: str, inside: tuple[str, ...]) -> str:
        if name in inside:
            raise node.fail(f"{{{{ {name} }}}} stands for itself: {' -> '.join((*inside, name))}")
        if name in self.variables:
            variable = self.variables[name]
            if not isinstance(variable.value, str):
                raise variable.fail(
                    f"must be text for {{{{ {name} }}}} in {node.path}, found {variable.described()}; put it in quotes"
                )
            return self.render(variable, variable.value, inside=(*inside, name))
        if name in self.environment:
            return self.environment[name]
        known = sorted(self.variables)
        raise node.fail(f"{{{{ {name} }}}} is neither in vars nor in the environment{nearest(name, known)}")
