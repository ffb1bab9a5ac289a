"""What befalls the programs of a storm: they are killed, or stand still for a while and go on as if nothing had happened."""

import random
import time
from collections.abc import Sequence
from typing import Final

from campaigns.storm.program import LOST
from robotapp_testbed import Process

STILL_S: Final = (1.0, 6.0)


class Misfortune:
    """One blow for every so many grants, so that a slow machine does not spend the storm on starting programs."""

    def __init__(self, processes: Sequence[Process], *, every: int, chance: random.Random) -> None:
        self._processes = processes
        self._every = every
        self._chance = chance
        self._next = every
        self._still: dict[str, float] = {}
        """Programs that stand still, and until when."""
        self.kills = self.stops = 0

    def __repr__(self) -> str:
        return f"<Misfortune of {len(self._processes)} programs: {self.kills} kills>"

    def strike(self, grants: int) -> None:
        """Kill or stop one when it is time, wake and start those whose time is over."""
        now_s = time.monotonic()
        for process in self._processes:
            if self._still.get(process.name, now_s) < now_s:
                del self._still[process.name]
                process.resume()
            process.start()  # does nothing to one that runs
        if grants < self._next:
            return
        self._next = grants + self._every
        process = self._chance.choice(self._processes)
        if self._chance.random() < 0.5:
            self._still.pop(process.name, None)
            process.kill()
            self.kills += 1
        elif process.name not in self._still:
            self._still[process.name] = now_s + self._chance.uniform(*STILL_S)
            process.pause()
            self.stops += 1

    def end(self) -> None:
        """Everybody goes on."""
        for process in self._processes:
            process.resume()
            process.start()
        self._still.clear()

    def kill_all(self) -> None:
        """Nobody goes on."""
        for process in self._processes:
            process.kill()
        self._still.clear()

    def lost_answers(self) -> int:
        """Answers that the programs lost, from their logs."""
        return sum(process.log_text().count(LOST) for process in self._processes)
