"""Values at a path below a pod's spec or a container, in which `[]` means every item of a list."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any


def walk_path(node: Any, steps: Sequence[str], at: str) -> Iterator[tuple[str, Any]]:
    """Yields place and value of what stands at `steps`, such as ("ports[]", "hostPort"), below a node that stands at `at`."""
    if not steps:
        yield at, node
        return
    name, several = steps[0].removesuffix("[]"), steps[0].endswith("[]")
    value = node.get(name) if isinstance(node, Mapping) else None
    if value is None:
        return
    if not several:
        yield from walk_path(value, steps[1:], f"{at}.{name}")
        return
    for index, item in enumerate(value if isinstance(value, Sequence) and not isinstance(value, str) else ()):
        yield from walk_path(item, steps[1:], f"{at}.{name}[{index}]")
