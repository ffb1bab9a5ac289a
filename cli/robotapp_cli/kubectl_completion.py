"""`kubectl robotapp <TAB>`: kubectl runs `kubectl_complete-robotapp WORD…` and reads candidates, the last line says what else to offer.

The answer is that of `kubectl-robotapp`'s own completion, whose form for fish is the one kubectl expects (value, tab, help).
"""

import io
import os
import shlex
import sys
from contextlib import redirect_stdout, suppress
from typing import Final

from robotapp_cli.main import app

_PROGRAM: Final = "kubectl-robotapp"
_FILES_TOO: Final = ":0"
_NOTHING_ELSE: Final = ":4"
"""Directives of kubectl's completion: fall back to the names of files, or do not."""


def main() -> None:
    """Entry point; the last argument is the word being typed, empty for a new one."""
    os.environ |= {
        "_KUBECTL_ROBOTAPP_COMPLETE": "complete_fish",
        "_TYPER_COMPLETE_FISH_ACTION": "get-args",
        "_TYPER_COMPLETE_ARGS": shlex.join([_PROGRAM, *(sys.argv[1:] or [""])]),
    }
    with redirect_stdout(io.StringIO()) as answer, suppress(SystemExit):
        app(prog_name=_PROGRAM)
    found = [line for line in answer.getvalue().splitlines() if line]
    sys.stdout.write("\n".join([*found, _NOTHING_ELSE if found else _FILES_TOO]) + "\n")


if __name__ == "__main__":
    main()
