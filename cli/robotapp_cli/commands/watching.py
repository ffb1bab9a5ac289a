"""`-w` of `list` and `info`: the same page again whenever it has changed."""

import asyncio
import contextlib
import io
import sys
from collections.abc import Awaitable, Callable
from typing import Final

from robotapp_cli.failures import CliError, Exit
from robotapp_cli.reading.session import Session

PAUSE_S: Final = 2.0
_CLEAR: Final = "\x1b[H\x1b[2J"


class Page(io.StringIO):
    """Text that a command prints, with the terminal's own properties, so that colours and arrows stay."""

    encoding = sys.__stdout__.encoding if sys.__stdout__ else "utf-8"

    def isatty(self) -> bool:
        """Returns True: only a terminal is watched."""
        return True


def is_terminal() -> bool:
    """Returns whether a person looks at the output."""
    return sys.stdout.isatty()


async def pause(seconds: float) -> None:
    """Waits until the next look."""
    await asyncio.sleep(seconds)


async def watch(session: Session, show: Callable[[Session], Awaitable[None]]) -> None:
    """Shows the page again and again on the cleared terminal, until Ctrl-C. Raises CliError when there is no terminal."""
    if not is_terminal() or session.options.output.structured:
        raise CliError("-w paints a terminal anew; for programs: kubectl get robotapp -w -o json", code=Exit.USAGE)
    previous_text = ""
    while True:
        page = Page()
        with contextlib.redirect_stdout(page):
            await show(session)
        if page.getvalue() != previous_text:
            previous_text = page.getvalue()
            sys.stdout.write(_CLEAR + previous_text)
            sys.stdout.flush()
        await pause(PAUSE_S)
