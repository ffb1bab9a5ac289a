"""Images of the reference applications: whoever builds one, and when, gets the same bytes. Two of them, others every day; all with ROBOTAPP_IMAGES=all, which no landing sets: they take minutes."""

import hashlib
import logging
import os
import time
from pathlib import Path

import pytest
from tests.support.seeds import daily_seed

from robotapp_testbed import images
from robotapp_testbed.failures import TestbedError
from robotapp_testbed.images.reference import FOLDER

pytestmark = pytest.mark.live

logger = logging.getLogger(__name__)

APPS = sorted(path.parent.name for path in FOLDER.glob("*/Dockerfile"))
COUNT = 2
"""Applications of one day: five days have them all."""


def choose_apps() -> list[str]:
    if os.environ.get("ROBOTAPP_IMAGES") == "all":
        return APPS
    first = daily_seed() * COUNT % len(APPS)
    return APPS[first : first + COUNT]


def hash_file(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@pytest.mark.parametrize("app", choose_apps())
def test_two_builds_of_an_application_give_the_same_bytes(app: str, tmp_path: Path) -> None:
    try:
        earlier = images.archive(app)
    except TestbedError as reason:
        if "apt" not in str(reason):
            raise
        pytest.skip(str(reason))
    again = tmp_path / "again.tar"
    began_s = time.monotonic()
    images.build(app, images.RECIPES[app](), again)
    logger.info("%s: built in %.0f s, %.0f MB", app, time.monotonic() - began_s, again.stat().st_size / 1e6)
    assert hash_file(again) == hash_file(earlier)
    again.unlink()
