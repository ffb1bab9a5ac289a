"""One set of namespaces per application, in which each test starts programs of its own."""

from collections.abc import Callable, Iterator

import pytest
from tests.live.reference.programs import Programs, start_box

from robotapp_testbed.real.image_box import ImageBox


@pytest.fixture(scope="session")
def boxes(real_machine: object) -> Iterator[dict[str, ImageBox]]:
    """Unpacked images by application, as tests have needed them so far."""
    del real_machine  # skips where namespaces cannot be made
    boxes: dict[str, ImageBox] = {}
    yield boxes
    for box in boxes.values():
        box.box.kill()


@pytest.fixture
def run_app(
    boxes: dict[str, ImageBox], tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Callable[[str], Programs]]:
    """Returns what starts nodes of an application; they end with the test."""
    started: list[Programs] = []

    def run(app: str) -> Programs:
        if app not in boxes:
            boxes[app] = start_box(app, tmp_path_factory.mktemp(app) / "run")
        started.append(Programs(app, boxes[app]))
        return started[-1]

    yield run
    for programs in started:
        programs.close()
