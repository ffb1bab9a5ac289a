"""Images of the real nodes' containers, built without Docker and kept in the cache.

archive("pause")  # path of an OCI archive, built when its inputs have changed
reference("pause")  # the name a pod calls it by, once it is imported
"""

import hashlib
import tempfile
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Final

from robotapp_testbed.binaries import cache
from robotapp_testbed.failures import TestbedError
from robotapp_testbed.images import oci
from robotapp_testbed.images.pythonic import Component, Ros1, Ros2, Ros2Jazzy, Zenoh
from robotapp_testbed.images.recipes import Pause, Recipe, Tools
from robotapp_testbed.images.reference import ReferenceRos1, ReferenceRos2
from robotapp_testbed.progress import Progress

RECIPES: Final[Mapping[str, Callable[[], Recipe]]] = {
    "pause": Pause,
    "tools": Tools,
    "operator": partial(Component, "operator"),
    "scheduler": partial(Component, "scheduler"),
    "agent": partial(Component, "agent", extra="driver"),
    "console": partial(Component, "console"),
    "ros2": Ros2,
    "jazzy": Ros2Jazzy,
    "zenoh": Zenoh,
    "ros1": Ros1,
    "detection-ros1": partial(ReferenceRos1, "detection-ros1", "learning", "reference_detection.detector"),
    "detection-ros2": partial(ReferenceRos2, "detection-ros2", "detection", "reference_detection.detector"),
    "fleet-ros1": partial(ReferenceRos1, "fleet-ros1"),
    "fleet-ros2": partial(ReferenceRos2, "fleet-ros2"),
    "navigation-ros1": partial(ReferenceRos1, "navigation-ros1"),
    "navigation-ros2": partial(ReferenceRos2, "navigation-ros2", "navigation"),
    "teleop-ros1": partial(ReferenceRos1, "teleop-ros1"),
    "teleop-ros2": partial(ReferenceRos2, "teleop-ros2"),
    "usb-sensor-ros1": partial(ReferenceRos1, "usb-sensor-ros1"),
    "usb-sensor-ros2": partial(ReferenceRos2, "usb-sensor-ros2"),
}
_FORMAT = 1
"""Raised when the same inputs shall give other bytes."""


def reference(name: str) -> str:
    return f"localhost/robotapp-{name}:testbed"


def archive(name: str, *, home: Path | None = None, progress: Progress | None = None) -> Path:
    """TestbedError names a missing package or an unknown image."""
    if name not in RECIPES:
        raise TestbedError(f"there is no image {name!r}, known are {', '.join(RECIPES)}")
    recipe = RECIPES[name]()
    key = hashlib.sha256(f"{_FORMAT} {reference(name)} {recipe.config()}".encode() + recipe.inputs()).hexdigest()[:16]
    store = cache.Store((home or cache.cache_home()) / "images" / key)
    file = f"{name}.tar"
    say = (progress or Progress()).say
    with store.adding(file, on_wait=partial(say, f"image {name} is being built by another process")) as target:
        if target:
            say(f"image {name}: building {reference(name)}")
            build(name, recipe, target)
    return store.path(file)


def build(name: str, recipe: Recipe, target: Path) -> None:
    with tempfile.TemporaryDirectory(dir=target.parent, prefix=f".{name}-") as scratch:
        oci.write(target, reference(name), recipe.fill(Path(scratch)), recipe.config())
