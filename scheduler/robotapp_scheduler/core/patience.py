"""When it pays to leave rows in doubt: not where pods come to the best rows only, or all must soon be added up anyway."""

from typing import Final

MOST_LOOKS: Final = 8
"""Rows looked at one by one in one decision, before all are added up: in columns they cost a third each."""
SOON: Final = 32
"""When all must be added up after fewer decisions than this, though few rows were in doubt, it does not pay."""
WINDOW: Final = 16
"""Decisions after which is asked whether it pays."""
REST: Final = 16
"""Decisions until it is tried again; twice as many after each time that it did not pay."""
MOST_REST: Final = 4096


class Patience:
    """What doubting saved and cost one class of late."""

    __slots__ = ("_came", "_decisions", "_looked", "_looks", "_pause", "_rest")

    def __init__(self) -> None:
        self._pause, self._rest = 0, REST
        self._decisions = 0
        """Since all rows were added up."""
        self._looks = 0
        """Rows looked at one by one in this decision."""
        self._came = self._looked = 0
        """Rows that changed, and rows looked at one by one, in this window."""

    def __repr__(self) -> str:
        return f"Patience({self._decisions} decisions, {self._looked} of {self._came} rows looked at, {self._pause} to rest)"

    def rest(self) -> bool:
        """One more decision goes by in which nothing may be doubted. False: it may."""
        resting = self._pause > 0
        self._pause -= resting
        return resting

    def begin(self, came: int) -> None:
        """The next decision, before which so many rows changed."""
        if self._decisions % WINDOW == 0:
            self._came = self._looked = 0
        self._came += came
        self._looked += self._looks
        self._looks = 0
        self._decisions += 1

    @property
    def pays(self) -> bool:
        """At the end of a window: were at most half of the rows that changed looked at one by one?"""
        return self._decisions % WINDOW != 0 or 2 * self._looked <= self._came

    def look(self, rows: int) -> None:
        """So many rows are to be looked at one by one."""
        self._looks += rows

    @property
    def overtaxed(self) -> bool:
        """Is it quicker to add all of them up?"""
        return self._looks > MOST_LOOKS

    def added_up(self) -> None:
        """No row is in doubt any more."""
        self._decisions = 0

    def lose(self) -> bool:
        """It did not pay. True: not for long enough, so nothing is doubted for some time."""
        if self._decisions >= SOON:
            self._rest = REST
            return False
        self._pause = self._rest
        self._rest = min(2 * self._rest, MOST_REST)
        return True
