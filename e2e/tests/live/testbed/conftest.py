"""A command line with clusters of its own, and a reader who types into it."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from e2e.tests.live.testbed.reader import Reader, Shell


@pytest.fixture
def shell(tmp_path: Path) -> Iterator[Shell]:
    made = Shell(tmp_path)
    yield made
    for name in ("default", "second"):
        made.cluster(name).down()


@pytest.fixture
def reader(shell: Shell, tmp_path: Path) -> Reader:
    return Reader(shell, tmp_path / "reader")
