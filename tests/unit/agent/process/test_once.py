"""`robotapp-agent --once` on a host that looks like a robot."""

import json
from pathlib import Path

import pytest

from robotapp_agent.main import main
from robotapp_agent.process import once
from robotapp_testbed.machines.fake_host import FakeHost


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(once, "_BETWEEN_S", 0.0)
    host = FakeHost(tmp_path)
    host.camera("1-2")
    zone = tmp_path / "sys/class/thermal/thermal_zone0"
    zone.mkdir(parents=True)
    (zone / "type").write_text("cpu-thermal\n")
    (zone / "temp").write_text("45000\n")
    cell = tmp_path / "sys/class/power_supply/BAT0"
    cell.mkdir(parents=True)
    for name, text in (("type", "Battery"), ("capacity", "64"), ("status", "Charging")):
        (cell / name).write_text(text)
    return tmp_path


def test_people_see_a_line_per_fact(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--once", f"--host-root={root}"]) == 0
    shown = capsys.readouterr().out
    assert "temperature   cpu-thermal 45 °C" in shown
    assert "battery       64 %, on external power" in shown
    assert "memory " in shown
    assert "/dev/video0" in shown


def test_programs_see_the_status_as_it_would_be_written(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--once", "--json", f"--host-root={root}"]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert shown["battery"] == {"percent": 64, "charging": True}
    assert any(device["type"] == "video" and device["present"] for device in shown["devices"])
    assert "seq" not in shown


def test_what_is_wrong_with_the_rules_is_told(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rules = root / "rules.yaml"
    rules.write_text("- nonsense: 1\n")
    assert main(["--once", f"--host-root={root}", f"--device-rules={rules}"]) == 0
    assert "robotapp-agent: " in capsys.readouterr().err


def test_an_empty_machine_is_no_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(once, "_BETWEEN_S", 0.0)
    assert main(["--once", f"--host-root={tmp_path}"]) == 0
    assert "devices       none" in capsys.readouterr().out
