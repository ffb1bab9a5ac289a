"""Chromium of this machine, driven by Playwright: found, installed where that is possible, opened."""

import os
import shutil
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from playwright.sync_api import Browser, sync_playwright

from robotapp_testbed.failures import TestbedError, last_words

PACKAGE: Final = "chromium-headless-shell"
"""Debian's smallest package of it: no window system, a quarter of the download."""
FONTS: Final = "fonts-dejavu-core"
PROGRAMS: Final = ("chromium-headless-shell", "chromium")
REBOUND_HOST: Final = "rebound.example"
"""A name that the browser resolves to 127.0.0.1, as an attacker's name server would do after a while."""
_INSTALL_S: Final = 300.0
_FLAGS: Final = (
    "--no-sandbox",  # root has none, and it opens pages of our own only
    "--disable-dev-shm-usage",  # containers have little shared memory
    f"--host-resolver-rules=MAP {REBOUND_HOST} 127.0.0.1",
)


class NoBrowserError(TestbedError):
    """No browser can be opened on this machine; the message says why and what to do."""


def find_chromium(programs: Sequence[str] = PROGRAMS) -> Path | None:
    """Returns the browser's program, None when there is none."""
    return next((Path(path) for name in programs if (path := shutil.which(name))), None)


def get_chromium(programs: Sequence[str] = PROGRAMS) -> Path:
    """Returns the browser's program, which root gets from Debian when it is absent. Raises NoBrowserError."""
    present = find_chromium(programs)
    if present is not None:
        return present
    line = f"apt-get install --no-install-recommends {PACKAGE} {FONTS}"
    if os.geteuid() != 0 or shutil.which("apt-get") is None:
        raise NoBrowserError(f"pages are tested in Chromium, which is not installed: {line}")
    _install()
    installed = find_chromium(programs)
    if installed is None:
        raise NoBrowserError(f"apt installed {PACKAGE}, but there is no program {' or '.join(programs)}: try {line}")
    return installed


def _install() -> None:
    environment = os.environ | {"DEBIAN_FRONTEND": "noninteractive"}
    quiet = ("-qq", "-o", "Acquire::Retries=3")
    for command in (("update",), ("install", "-y", "--no-install-recommends", PACKAGE, FONTS)):
        result = subprocess.run(
            ["apt-get", *command, *quiet],
            env=environment,
            capture_output=True,
            text=True,
            check=False,
            timeout=_INSTALL_S,
        )
        if result.returncode != 0:
            raise NoBrowserError(f"apt cannot get {PACKAGE} ({last_words(result.stderr)}): install Chromium by hand")


@contextmanager
def open_browser() -> Iterator[Browser]:
    """Opens the browser without a window until the block ends. Raises NoBrowserError."""
    program = get_chromium()
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=program, args=list(_FLAGS))
        try:
            yield browser
        finally:
            browser.close()
