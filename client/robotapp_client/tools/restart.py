"""Starts this process again from nothing: after etcd was restored from a snapshot, what it knows may never have happened."""

import logging
import os
import sys
import time
from collections.abc import Callable, Mapping
from typing import Final, NoReturn

RESTORED: Final = 75
"""Exit status of a run that is to start again (EX_TEMPFAIL). The process has it only when it started again just before."""
STARTED_AGAIN: Final = "ROBOTAPP_STARTED_AGAIN"
"""Environment variable that carries when a process last started again, in seconds of the monotonic clock, into the next one."""
LEAST_PAUSE_S: Final = 60.0
"""Etcd is not restored twice in so short a time: somebody else, such as the kubelet with its back-off, has to slow us down."""

log = logging.getLogger(__name__)


def start_again(clock: Callable[[], float] = time.monotonic) -> int:
    """Replaces this process by a new one with the same command line. Its pod, process id and log stay.

    Returns the exit status to end with instead if it did so less than `LEAST_PAUSE_S` ago.
    """
    now_s = clock()
    if now_s - _last_time(os.environ) >= LEAST_PAUSE_S:
        _replace_process(now_s)
    log.error(
        "the API server went back to an older state again, less than %d s after the last time: this process ends with "
        "status %d, so that whoever runs it starts it later; do all API servers answer from the same etcd?",
        LEAST_PAUSE_S,
        RESTORED,
    )
    return RESTORED


def _replace_process(now_s: float) -> NoReturn:
    log.warning("the API server went back to an older state: this process starts again and reads everything anew")
    os.environ[STARTED_AGAIN] = repr(now_s)
    sys.stdout.flush()
    sys.stderr.flush()
    os.execv(sys.executable, sys.orig_argv)  # noqa: S606 - our own command line


def _last_time(environment: Mapping[str, str]) -> float:
    """Returns when a process with this environment started again; long ago if it never did or the text is no number."""
    try:
        return float(environment[STARTED_AGAIN])
    except (KeyError, ValueError):
        return float("-inf")
