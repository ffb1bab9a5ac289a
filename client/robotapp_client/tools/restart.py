"""How a process starts again from nothing: after etcd was restored from a snapshot, what it knows may never have happened."""

import logging
import os
import sys
from typing import Final, NoReturn

RESTORED: Final = 75
"""Exit status of a run that is to start again (EX_TEMPFAIL); it never leaves a process that calls `start_again`."""

log = logging.getLogger(__name__)


def start_again() -> NoReturn:
    """Replaces this process by a new one with the same command line. Its pod, process id and log stay."""
    log.warning("the API server went back to an older state: this process starts again and reads everything anew")
    sys.stdout.flush()
    sys.stderr.flush()
    os.execv(sys.executable, sys.orig_argv)  # noqa: S606 - our own command line
