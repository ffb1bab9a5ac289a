"""Checks recordings for what the schema lets through."""

import re
from collections.abc import Iterator

from robotapp_api.checks.problem import Note, Problem, invalid
from robotapp_api.checks.ros import ros_version_of
from robotapp_api.model.app.robotapp import RobotAppSpec
from robotapp_api.model.recording import Recording
from robotapp_api.values.quantities.duration import parse_us
from robotapp_api.values.quantities.quantity import parse_bytes

LEAST_SPLIT_BYTES = 1 << 20
"""A smaller bag would be closed several times a second."""
LEAST_SPLIT_US = 1_000_000


def recording_problems(spec: RobotAppSpec) -> Iterator[Problem]:
    """Problems of each recording, with its place in the spec."""
    if spec.recordings and ros_version_of(spec) != 2:
        yield invalid(
            "spec.recordings", "are for ROS 2; in ROS 1 write a component that runs rosbag record, with a volume"
        )
        return
    for index, recording in enumerate(spec.recordings):
        at = f"spec.recordings[{index}]"
        yield from _pattern_problems(recording, at)
        yield from _size_problems(recording, at)
        yield from _duration_problems(recording, at)


def recording_notes(spec: RobotAppSpec) -> Iterator[Note]:
    """Yields what a recording does less than its author may expect."""
    for index, recording in enumerate(spec.recordings):
        if recording.volume is None:
            yield Note(
                f"spec.recordings[{index}].volume",
                "is not written, so the bags are deleted with the pod; write {claimName: NAME} of a PersistentVolumeClaim to keep them",
            )


def _pattern_problems(recording: Recording, at: str) -> Iterator[Problem]:
    for field, pattern in (("regex", recording.topics.regex), ("exclude", recording.topics.exclude)):
        try:
            re.compile(pattern or "")
        except (re.error, OverflowError, RecursionError) as error:
            yield invalid(
                f"{at}.topics.{field}", f'{pattern} is no regular expression ({error}); write for example "/camera/.*"'
            )


def _duration_problems(recording: Recording, at: str) -> Iterator[Problem]:
    text = recording.split.duration
    if text is None:
        return
    try:
        duration_us = parse_us(text)
    except (ValueError, OverflowError):
        yield invalid(f"{at}.split.duration", f"{text} is longer than any recording; write for example 10m")
        return
    if duration_us < LEAST_SPLIT_US:
        yield invalid(f"{at}.split.duration", f"{text} would begin a bag with every message; write at least 1s")


def _size_problems(recording: Recording, at: str) -> Iterator[Problem]:
    try:
        split_bytes, retain_bytes = parse_bytes(recording.split.size), parse_bytes(recording.retain.size)
    except ValueError as error:
        yield invalid(f"{at}.split.size", f"{error}; write sizes such as 256Mi and 5Gi")
        return
    if split_bytes < LEAST_SPLIT_BYTES:
        yield invalid(f"{at}.split.size", f"{recording.split.size} is less than a chunk; write at least 1Mi")
    elif retain_bytes < 2 * split_bytes:
        yield invalid(
            f"{at}.retain.size",
            f"{recording.retain.size} holds less than two bags of {recording.split.size}, so only the open one would be kept; "
            "write at least twice split.size, or a smaller split.size",
        )
