"""What a cluster of real nodes is made from, beside the pinned programs."""

from collections.abc import Sequence

from robotapp_testbed import images
from robotapp_testbed.binaries import programs


def prepare(names: Sequence[str] = ("tools",)) -> None:
    """Compile our Go programs and make the images of these names: with an empty cache the first start waits a minute for them.

    Raises TestbedError as their makers do.
    """
    for program in programs.FOLDERS:
        programs.build(program)
    for image in ("pause", *names):
        images.archive(image)
