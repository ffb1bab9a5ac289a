"""The plugin classes without Rigel: settings, files, errors in Rigel's manner, and the way into the cluster."""

import sys
from pathlib import Path
from types import ModuleType
from typing import Any, Protocol

import pytest
import yaml
from tests.support.rigel.rigelfiles import ONE, orchestration
from tests.unit.bridge.fake_cluster import FakeCluster

import rigel_bridge
from rigel_bridge.document.failures import BridgeError
from rigel_bridge.main import main
from rigel_bridge.plugins import work
from rigel_bridge.plugins.rigel02 import plugin

EXAMPLE = Path(__file__).resolve().parents[4] / "examples" / "rigel" / "teleop" / "Rigelfile"


class RigelError(Exception):
    """As in Rigel 0.2: `base` is formatted."""

    base = ""
    code = 1

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(self.base.format(**kwargs))


def deploy(folder: Path, text: str, **kwargs: Any) -> None:
    """What `rigel deploy` does with our entry."""
    (folder / "Rigelfile").write_text(text)
    made = plugin(RigelError)(**kwargs)
    made.run()
    made.stop()


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_the_file_has_the_bytes_of_render_also_for_the_shipped_example(tmp_path: Path) -> None:
    for text in (orchestration("{name: teleop}"), EXAMPLE.read_text()):
        deploy(tmp_path, text, output="k8s/app.yaml")
        assert main(["render", "-o", "rendered.yaml"]) == 0
        assert Path("k8s/app.yaml").read_bytes() == Path("rendered.yaml").read_bytes()


def test_without_output_the_file_is_named_after_the_app(tmp_path: Path) -> None:
    deploy(tmp_path, orchestration("{name: teleop}"))
    assert yaml.safe_load(Path("teleop.robotapp.yaml").read_text())["metadata"]["name"] == "teleop"


def test_errors_have_our_code_and_braces_do_not_break_them(tmp_path: Path) -> None:
    with pytest.raises(RigelError, match=r"\{\{ NOT_SET \}\} is not in vars") as caught:
        deploy(tmp_path, ONE.replace(":1", ":{{ NOT_SET }}"))
    assert caught.value.code == 72
    with pytest.raises(RigelError, match="Rigelfile:2: "):
        deploy(tmp_path, "packages: [")


def test_arguments_without_a_name_are_refused() -> None:
    with pytest.raises(RigelError, match="settings stand in kwargs"):
        plugin(RigelError)("teleop").run()


def test_a_bug_of_ours_is_a_line_and_no_traceback(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(_: object, **__: object) -> None:
        raise KeyError("x")

    monkeypatch.setattr(work, "settings", broken)
    with pytest.raises(RigelError, match="rigel_bridge has a bug: KeyError: 'x'"):
        deploy(tmp_path, ONE)


@pytest.mark.parametrize(
    "wrong",
    [
        {"output": "/etc/passwd"},
        {"output": "../x"},
        {"output": 3},
        {"output": "Rigelfile"},
        {"output": "./Rigelfile"},
        {"output": "a\0b"},
        {"apply": "yes"},
        {"wait": "soon"},
        {"namespace": 1},
    ],
    ids=str,
)
def test_settings_that_cannot_be_meant_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(BridgeError, match="is not allowed; allowed: "):
        work.settings(wrong)


@pytest.mark.parametrize("output", ["k8s/deeper/app.yaml", "app.yaml", None])
def test_nothing_is_written_through_a_link_of_the_checkout(
    output: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    outside = tmp_path / "home"
    outside.mkdir()
    secret = outside / "authorized_keys"
    secret.write_text("mine")
    (tmp_path / "ws").mkdir()
    monkeypatch.chdir(tmp_path / "ws")
    Path("k8s").symlink_to(outside)
    Path("app.yaml").symlink_to(secret)
    Path("teleop.robotapp.yaml").symlink_to(outside / "new")
    with pytest.raises(RigelError, match="is a link"):
        deploy(tmp_path / "ws", orchestration("{name: teleop}"), **({"output": output} if output else {}))
    assert secret.read_text() == "mine"
    assert [each.name for each in outside.iterdir()] == ["authorized_keys"]


def test_apply_brings_the_app_into_the_cluster(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cluster = FakeCluster()
    monkeypatch.setattr(work, "kubectl_of", lambda _: cluster)
    deploy(tmp_path, orchestration("{name: teleop}"), apply=True)
    assert ("robotapps", "teleop") in cluster.objects
    with pytest.raises(RigelError, match="is not Ready within 0 s"):
        deploy(tmp_path, orchestration("{name: teleop}"), wait="0s")


class _Protocol(Protocol):
    def run(self) -> None: ...


class _Class: ...


@pytest.mark.parametrize(
    ("base", "name", "told"),
    [
        (None, "Plugin", "Rigel is not installed here"),
        (_Protocol, "RobotAppPlugin", "write for Rigel 0.2"),
        (_Class, "Plugin", "write for Rigel 0.3"),
        (_Class, "Nonsense", "has no attribute 'Nonsense'"),
    ],
)
def test_a_class_for_another_rigel_is_named(base: Any, name: str, told: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("rigel", "rigel.plugins"):
        made = ModuleType(module)
        made.Plugin = base  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, module, made if base else None)
    with pytest.raises(AttributeError, match=told):
        getattr(rigel_bridge, name)
