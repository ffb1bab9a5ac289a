"""Opens the browser of the person who started the console, with a file instead of the one-time address.

The address would be on the browser's command line, which every user of the machine can read.
"""

import html
import logging
import os
import shutil
import tempfile
import threading
import webbrowser
from pathlib import Path

log = logging.getLogger(__name__)


class OpeningPage:
    """A file of this user alone that leads the browser on. It is there from `show` to `remove`."""

    def __init__(self) -> None:
        self._folder: Path | None = None

    def __repr__(self) -> str:
        return f"<OpeningPage in {self._folder}>"

    def show(self, address: str) -> None:
        """Opens the browser and does not wait for it: one in the terminal runs until its user leaves it. Where the file cannot be written, the log says so: the address was printed as well."""
        try:
            self._folder = Path(tempfile.mkdtemp(prefix="robotapp-console-", dir=_find_place()))
            page = self._folder / "open.html"
            page.touch(mode=0o600)
            page.write_text(_render(address), encoding="utf-8")
        except OSError as error:
            log.error("open the printed address yourself: a page for the browser cannot be written: %s", error)  # noqa: TRY400 - the cause is enough
            return
        threading.Thread(target=webbrowser.open, args=(page.as_uri(),), daemon=True).start()

    def remove(self) -> None:
        """Removes the file, if there is one."""
        folder, self._folder = self._folder, None
        if folder is not None:
            shutil.rmtree(folder, ignore_errors=True)


def _find_place() -> Path | None:
    """Returns the user's home, None where it cannot be written: browsers in a sandbox read no hidden folder and no other place."""
    try:
        home = Path.home()
    except RuntimeError:  # a user without one
        return None
    return home if os.access(home, os.W_OK) else None


def _render(address: str) -> str:
    target = html.escape(address)
    return (
        '<!doctype html><meta charset="utf-8"><meta name="referrer" content="no-referrer">'
        f'<meta http-equiv="refresh" content="0; url={target}"><title>RobotApp</title><a href="{target}">Open the console</a>\n'
    )
