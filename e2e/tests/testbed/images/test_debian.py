"""Debian packages as image content."""

from pathlib import Path

import pytest

from robotapp_testbed.failures import TestbedError
from robotapp_testbed.images import debian


def test_a_package_that_cannot_be_had_is_said_with_the_advice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("apt-get", "dpkg-deb", "tar"):
        (tmp_path / name).write_text('#!/bin/sh\necho "E: Unable to locate package missing" >&2; exit 100\n')
        (tmp_path / name).chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    with pytest.raises(TestbedError, match=r"apt cannot get missing \(E: Unable to locate.*\): apt-get update"):
        debian.closure(["missing"])
