"""Something done again every few seconds in a thread of its own, for as long as a stand-in for node agents lives."""

import logging
import threading
from collections.abc import Callable

from robotapp_testbed.failures import TestbedError

_LOG = logging.getLogger(__name__)


class Heartbeat:
    """Calls `beat` each `interval_s` seconds, the first time one interval after `start`."""

    def __init__(self, name: str, beat: Callable[[], object], *, interval_s: float) -> None:
        self._name = name
        self._beat = beat
        self._interval_s = interval_s
        self._stopped = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        self._thread = threading.Thread(target=self._run, name=self._name, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Returns when the last beat has ended."""
        self._stopped.set()
        if self._thread:
            self._thread.join()

    def _run(self) -> None:
        while not self._stopped.wait(self._interval_s):
            try:
                self._beat()
            except (OSError, TestbedError):  # the API server may be down on purpose; the next round tries again
                _LOG.warning("%s: a round could not be written", self._name, exc_info=True)
