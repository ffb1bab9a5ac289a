"""What goes wrong with one claim of a pass must not keep the pass from the others."""

import logging
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

import msgspec

from robotapp_claims.protocol.writes import Refused
from robotapp_client.transport.errors import ApiError, TooManyRequests, Unauthorized, describe

log = logging.getLogger(__name__)


class Troubles:
    """The errors of one pass, logged in one line at its end: a thousand claims may have the same one."""

    def __init__(self, counts: Counter[str]) -> None:
        self._counts = counts
        self._first: tuple[str, BaseException] | None = None
        self._count = 0

    def __repr__(self) -> str:
        return f"<Troubles with {self._count} claims>"

    @contextmanager
    def of(self, name: str) -> Iterator[None]:
        """Work on one claim. An error is noted and concludes nothing about the claim: it stays as it is.

        What stands in the way of every request is raised and ends the pass: no answer, no credentials, too many requests.
        """
        try:
            yield
        except Refused:
            self._counts["refused"] += 1  # another writer was faster: the next pass reads what it wrote
        except (TooManyRequests, Unauthorized):
            raise
        except (ApiError, msgspec.ValidationError) as error:
            self._note(name, error)
        except (ArithmeticError, AssertionError, AttributeError, LookupError, TypeError, ValueError) as bug:
            log.exception("claim %s: a bug; it stays as it is", name)
            self._note(name, bug)

    def log_summary(self) -> None:
        """Log what was noted."""
        if self._first is not None:
            name, error = self._first
            log.warning(
                "%d claims stay as they are because of errors, first %s: %s", self._count, name, describe(error)
            )

    def _note(self, name: str, error: BaseException) -> None:
        self._counts["failed claims"] += 1
        self._count += 1
        self._first = self._first or (name, error)
