from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.unit.cli.running import Stage


@pytest.fixture
def stage(tmp_path: Path) -> Iterator[Stage]:
    with Stage(tmp_path) as running:
        yield running
