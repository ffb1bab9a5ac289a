"""Broken Rigelfiles of every kind; `scripts/bench rigelfiles` runs thousands."""

from pathlib import Path

import pytest
from tests.support.rigel.cases import mutated
from tests.support.work_unit import is_within

from campaigns.bridge.bridge_watch import run
from rigel_bridge.document.failures import Exit


@pytest.mark.parametrize("seed", range(60))
def test_a_broken_file_ends_in_lines_and_a_code(seed: int, tmp_path: Path) -> None:
    path = tmp_path / "Rigelfile"
    path.write_bytes(mutated(seed))
    for arguments in (["render"], ["render", "--format", "manifests"], ["check"]):
        found = run(path, *arguments)
        assert found.code in {*Exit}
        assert found.foreign == []
        assert found.written < 1_000_000
        assert is_within(found.cpu_s, 1)
        assert all(line.isprintable() for line in found.lines)
