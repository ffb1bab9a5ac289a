"""Rigelfiles for the bridge's tests, and the bridge called on text."""

from collections.abc import Mapping
from typing import Any

import pytest

from rigel_bridge.document.failures import BridgeError
from rigel_bridge.document.tree import parse
from rigel_bridge.generations.g1 import load
from rigel_bridge.render.app import Rendered, render

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


def rendered(text: str, *, environment: Mapping[str, str] | None = None, **options: Any) -> Rendered:
    options.setdefault("name", "app")
    return render(load(parse(text.encode(), "Rigelfile"), environment or {}), **options)


def spec(text: str, **options: Any) -> Any:
    return rendered(text, **options).app["spec"]


def refusal(text: str, **options: Any) -> str:
    with pytest.raises(BridgeError) as caught:
        rendered(text, **options)
    return str(caught.value)
