"""Work in a thread of its own beside a test or a bench."""

import threading
from types import TracebackType
from typing import Self


class Background:
    """Runs `_run` in a thread while it is entered; `_run` returns soon after `_stop` is set.

    An error that ends `_run` is raised by `check`, and at the end of a block that ended well.
    """

    def __init__(self, name: str) -> None:
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run_guarded, name=name, daemon=True)
        self._error: BaseException | None = None

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop.set()
        self._thread.join()
        if error is None:
            self.check()

    def check(self) -> None:
        """Raises what ended the work."""
        if self._error is not None:
            raise self._error

    def _run_guarded(self) -> None:
        try:
            self._run()
        except BaseException as error:  # noqa: BLE001 - `check` raises it where it is looked for
            self._error = error

    def _run(self) -> None:
        raise NotImplementedError
