"""What a control plane answers before it runs, and what it asks for; starting it is tested live."""

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


class NoAssets(Assets):
    def __init__(self) -> None:
        super().__init__(env={"HOME": "/nowhere", "PATH": ""})
        self.asked: list[str] = []

    def resolve(self, names: object = ()) -> dict[str, Path]:
        self.asked = [str(name) for name in names]  # type: ignore[attr-defined]  # an iterable of names
        raise TestbedError("nothing here")


@pytest.mark.parametrize("use", ["server_url", "run_dir", "logs_dir", "bin_dir", "ca_file", "api"])
def test_before_the_start_everything_says_so(use: str) -> None:
    with pytest.raises(TestbedError, match="not started"):
        getattr(ControlPlane(assets=NoAssets()), use)


def test_commands_say_so_too() -> None:
    with pytest.raises(TestbedError, match="not started"):
        ControlPlane(assets=NoAssets()).kubectl("get", "nodes")


def test_the_audit_log_must_have_been_asked_for() -> None:
    with pytest.raises(TestbedError, match="start it with audit=True"):
        ControlPlane(assets=NoAssets()).audit()


@pytest.mark.parametrize(
    ("options", "missing"),
    [
        ({}, {"kube-scheduler"}),
        ({"kube_scheduler": True}, set()),
        ({"kwok": False}, {"kwok", "kube-scheduler"}),
        ({"controller_manager": False}, {"kube-controller-manager", "kube-scheduler"}),
    ],
)
def test_only_the_programs_that_will_run_are_asked_for(options: dict[str, bool], missing: set[str]) -> None:
    assets = NoAssets()
    with pytest.raises(TestbedError, match="nothing here"):
        ControlPlane(assets=assets, **options).start()  # type: ignore[arg-type]  # flags only
    everything = {"etcd", "kube-apiserver", "kube-controller-manager", "kwok", "kube-scheduler", "kubectl", "helm"}
    assert set(assets.asked) == everything - missing


def test_closing_what_never_started_is_fine() -> None:
    plane = ControlPlane(assets=NoAssets())
    plane.close()
    plane.close()
    assert "not started" in repr(plane)
