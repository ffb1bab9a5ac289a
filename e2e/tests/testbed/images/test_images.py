"""Archives in the cache: built once per state of their inputs, the same bytes wherever they are built."""

import io
from collections.abc import Sequence
from pathlib import Path

import pytest

from robotapp_testbed import images
from robotapp_testbed.images import oci, recipes
from robotapp_testbed.progress import Progress

QUIET = Progress(stream=io.StringIO())


class Little(recipes.Recipe):
    content = b"one"
    built = 0

    def inputs(self) -> bytes:
        return self.content

    def fill(self, scratch: Path) -> Sequence[Path]:
        type(self).built += 1
        layer = recipes.skeleton(scratch / "layer")
        (layer / "content").write_bytes(self.content)
        return [layer]

    def config(self) -> oci.Config:
        return oci.Config(entrypoint=["/x"], architecture="amd64")


@pytest.fixture
def little(monkeypatch: pytest.MonkeyPatch) -> type[Little]:
    monkeypatch.setattr(images, "RECIPES", {"little": Little})
    monkeypatch.setattr(Little, "built", 0)
    return Little


def test_an_archive_is_built_again_only_when_its_inputs_change(
    little: type[Little], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = images.archive("little", home=tmp_path, progress=QUIET)
    assert images.archive("little", home=tmp_path, progress=QUIET) == first
    assert little.built == 1
    monkeypatch.setattr(little, "content", b"two")
    assert images.archive("little", home=tmp_path, progress=QUIET) != first
    assert little.built == 2


def test_two_builds_are_equal_byte_by_byte(little: type[Little], tmp_path: Path) -> None:
    one = images.archive("little", home=tmp_path / "a", progress=QUIET)
    other = images.archive("little", home=tmp_path / "b", progress=QUIET)
    assert little.built == 2
    assert one.read_bytes() == other.read_bytes()
