"""What is checked before a control plane starts."""

import tempfile
from collections.abc import Iterable
from pathlib import Path
from types import SimpleNamespace

import pytest

from robotapp_testbed import ControlPlane, TestbedError
from robotapp_testbed.binaries.assets import Assets


class SomeAssets(Assets):
    """Programs of which nothing is asked."""

    def resolve(self, names: Iterable[str] = ()) -> dict[str, Path]:
        return {str(name): Path("/bin/false") for name in names}


def test_a_disk_without_room_is_told_before_anything_starts(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr("shutil.disk_usage", lambda _: SimpleNamespace(free=99 << 20))
    with pytest.raises(TestbedError) as refused:
        ControlPlane(assets=SomeAssets()).start()
    assert str(refused.value) == (
        f"{tmp_path} has 99 MB left, this cluster needs 160 MB: free some, or name another folder in TMPDIR"
    )
    assert list(tmp_path.iterdir()) == []
