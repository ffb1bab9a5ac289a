"""Rigelfiles for the bridge's tests, and the bridge called on text."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest

from rigel_bridge.document.failures import BridgeError
from rigel_bridge.document.tree import parse
from rigel_bridge.generations.load import load
from rigel_bridge.generations.model import Options
from rigel_bridge.render.app import Naming, Rendered, render

ONE = """\
packages:
  - package: base_driver
    distro: humble
    image: acme/driver:1
    command: ros2 run base_driver driver
"""
TWO = ONE + "  - {package: operator_ui, dockerfile: docker/ui, image: 'acme/ui:1'}\n"


def orchestration(block: str, packages: str = ONE) -> str:
    """A Rigelfile whose orchestration block is `block` (flow style, or lines without indentation)."""
    lines = "".join(f"        {line}\n" for line in block.splitlines())
    return f"{packages}deploy:\n  - name: acme/rigel_bridge\n    kwargs:\n      orchestration:\n{lines}"


def rendered_all(
    text: str,
    *,
    environment: Mapping[str, str] | None = None,
    name: str = "app",
    override: bool = False,
    **options: Any,
) -> list[Rendered]:
    """Every RobotApp of a Rigelfile. `today` and `namespace` go to the naming, everything else says how to read."""
    naming = {key: options.pop(key) for key in ("today", "namespace") if key in options}
    rigelfile = load(parse(text.encode(), "Rigelfile"), Options(environment=environment or {}, **options))
    found = [render(target, Naming(name, override, **naming)) for target in rigelfile.targets]
    first = rigelfile.notes
    return [replace(one, notes=(*first, *one.notes), plain_notes=(*first, *one.plain_notes)) for one in found]


def rendered(text: str, **options: Any) -> Rendered:
    (one,) = rendered_all(text, **options)
    return one


def spec(text: str, **options: Any) -> Any:
    return rendered(text, **options).app["spec"]


def refusal(text: str, **options: Any) -> str:
    with pytest.raises(BridgeError) as caught:
        rendered(text, **options)
    return str(caught.value)
