"""What the source of packages shows, read by ros_profile: for `--profile`. The only place that imports its readers, when asked to."""

import sys
from pathlib import Path

from rigel_bridge.document.failures import BridgeError, Exit, Place
from rigel_bridge.render.inferred import Inference


def inferences(path: Path) -> dict[str, Inference]:
    """By package name, of every package at or below a folder. BridgeError when it cannot be read or ros_profile is missing."""
    place = Place(str(path))
    try:
        from ros_profile.generate import generate_profile
        from ros_profile.main import end_progress, show_progress
        from ros_profile.output.robotapp import needs
        from ros_profile.output.values import distinct, perhaps
    except ImportError as error:
        raise BridgeError(
            place,
            f"--profile needs {error.name}: pip install '.[profile]' in a clone of RobotApp",
            code=Exit.UNREADABLE,
        ) from error
    try:
        watched = sys.stderr.isatty()
        profile = generate_profile(path, progress=show_progress if watched else None)
        if watched:
            end_progress()
    except OSError as error:
        raise BridgeError(place, f"cannot be read: {error.strerror}", code=Exit.UNREADABLE) from error
    if not profile.packages:
        raise BridgeError(place, "has no package.xml that can be read, here or below", code=Exit.UNREADABLE)
    found: dict[str, Inference] = {}
    for package in profile.packages:
        own = package.assessment
        found.setdefault(
            package.name,
            Inference(
                fields=needs(own, distinct(own.hardware)),
                confidence=own.qos_class.confidence if own.qos_class else 0.0,
                doubts=tuple(perhaps(one) for one in own.doubted),
            ),
        )
    return found
