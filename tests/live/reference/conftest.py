"""One set of namespaces per test: what a node of a past test leaves in the graph meets nobody."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from tests.live.reference.programs import Programs


@pytest.fixture
def run_app(real_machine: object, tmp_path: Path) -> Iterator[Callable[[str], Programs]]:
    """Unpacks the image of an application; its programs end with the test."""
    del real_machine  # skips where namespaces cannot be made
    started: list[Programs] = []

    def run(app: str) -> Programs:
        started.append(Programs(app, tmp_path / app))
        return started[-1]

    yield run
    for programs in started:
        programs.close()
