"""Who wishes for something in a storm: in a thread of its own, so many go each second and as many come.

Four fifths of those that go hold a domain or a device: by chance alone it would be a fifth, and the others would wish in
vain. Where fewer hold something than shall go, fewer go: programs that cannot keep up shall grant, not clean up after
wishes that were never looked at. With `full` those that wait make up the rest, however few hold something: the rate is
kept, and the programs do little but clean up.
"""

import random
import statistics
import time
from collections.abc import Callable, Collection, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from types import TracebackType
from typing import Final, Self

from campaigns.common.background import Background
from campaigns.rigs.simulated_site import SimulatedSite
from campaigns.storm.wishes import KINDS, is_pod, wish
from robotapp_testbed.failures import ApiStatusError

Wish = tuple[str, str]
"""(kind, name)."""
CHURN: Final = 0.1
"""Of what is wanted, this much shall go each second."""
SERVED: Final = 0.8
ROUND_S: Final = 1.0
PEOPLE: Final = 8
"""Requests at once."""
OVERLOADED: Final = (429, 500, 503, 504)
"""Answers of a server that has too much to do: of a write nobody knows whether it was done."""


class Churn(Background):
    """`with` it, the churn goes on. `there`: what was made and not deleted; `holders` names those that hold something."""

    def __init__(
        self,
        site: SimulatedSite,
        *,
        wanted: int,
        chance: random.Random,
        holders: Callable[[], Collection[str]],
        full: bool = False,
    ) -> None:
        self._site = site
        self._wanted = wanted
        self._chance = chance
        self._holders = holders
        self._full = full
        super().__init__("churn")
        self._rounds_s: list[float] = []
        self._short = self._began_s = self._ended_s = 0.0
        self._doubtful: list[Wish] = []
        """Nobody knows whether they are there; they are deleted with the next that go."""
        self.there: list[Wish] = []
        self.made = self.gone = self.unanswered = 0

    def __repr__(self) -> str:
        return f"<Churn of {len(self.there)}: {self.per_second:.1%}/s, limited by {self.limit}>"

    def __enter__(self) -> Self:
        self._began_s = time.monotonic()
        return super().__enter__()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        super().__exit__(kind, error, trace)
        self._ended_s = time.monotonic()

    @property
    def per_second(self) -> float:
        """The share of what is wanted that went each second, so far."""
        seconds = (self._ended_s or time.monotonic()) - self._began_s
        return self.gone / seconds / self._wanted

    @property
    def limit(self) -> str:
        """What kept it from the rate it shall have."""
        if not self._rounds_s:
            return "nothing yet"
        slow = [round_s for round_s in self._rounds_s if round_s > ROUND_S]
        reasons = []
        if len(slow) * 10 > len(self._rounds_s):
            share, median_s = len(slow) / len(self._rounds_s), statistics.median(slow)
            reasons.append(f"the API server ({share:.0%} of the rounds took longer than a second, {median_s:.1f} s)")
        if self._short * 10 > len(self._rounds_s):
            reasons.append(f"grants (in {self._short / len(self._rounds_s):.0%} of the rounds too few held anything)")
        return " and ".join(reasons) or "nothing"

    def keep(self, kept: Iterable[Wish]) -> None:
        """Delete all others; for after the churn."""
        kept = set(kept)
        with ThreadPoolExecutor(PEOPLE) as people:
            list(people.map(self._delete, [each for each in self.there if each not in kept]))

    def _run(self) -> None:
        with ThreadPoolExecutor(PEOPLE) as people:
            while not self._stop.is_set():
                began_s = time.monotonic()
                went = self._round(people)
                round_s = time.monotonic() - began_s
                if went:  # else it was the first, in which all come
                    self._rounds_s.append(round_s)
                self._stop.wait(max(0.0, ROUND_S - round_s))

    def _round(self, people: ThreadPoolExecutor) -> int:
        """How many went."""
        going = self._going(self._holders())
        coming = [self._wish() for _ in range(self._wanted - len(self.there))]
        doubtful, self._doubtful = self._doubtful, []
        list(people.map(self._delete, [*doubtful, *going]))
        made = [what for what, done in zip(coming, people.map(self._create, coming), strict=True) if done]
        self.there = self.there + made  # another thread may be reading the old one
        self.gone += len(going)
        return len(going)

    def _going(self, holders: Collection[str]) -> list[Wish]:
        """Takes them off the list: some of those who hold something, and a quarter as many by chance of those who wait."""
        if len(self.there) < self._wanted:
            return []
        shuffled = self._chance.sample(self.there, len(self.there))
        most = int(self._wanted * CHURN * SERVED)
        served = [what for what in shuffled if what[1] in holders][:most]
        self._short += not self._full and len(served) < most
        waiting = [what for what in shuffled if what[1] not in holders]
        also = int(self._wanted * CHURN) - len(served) if self._full else round(len(served) * (1 - SERVED) / SERVED)
        going = served + waiting[: max(1, also)]
        gone = set(going)
        self.there = [what for what in self.there if what not in gone]
        return going

    def _wish(self) -> Wish:
        self.made += 1
        return self._chance.choice(KINDS), f"s-{self.made}"

    def _create(self, what: Wish) -> bool:
        path = path_of(self._site, what[0])
        return self._answered(what, lambda: self._site.cp.api.create(path, wish(*what)))

    def _delete(self, what: Wish) -> bool:
        path = f"{path_of(self._site, what[0])}/{what[1]}"
        return self._answered(what, lambda: self._site.cp.api.delete(path), 404, 409)

    def _answered(self, what: Wish, request: Callable[[], object], *allowed: int) -> bool:
        """A server that cannot answer in time is part of a storm; then False, and the wish is doubtful."""
        try:
            with refusals(*allowed):
                request()
        except ApiStatusError as error:
            if error.status not in OVERLOADED:
                raise
        except OSError:
            pass
        else:
            return True
        self._doubtful.append(what)
        self.unanswered += 1
        return False


def path_of(site: SimulatedSite, kind: str) -> str:
    return f"/api/v1/namespaces/{site.namespace}/pods" if is_pod(kind) else site.apps_path


@contextmanager
def refusals(*allowed: int, note: Callable[[], None] = lambda: None) -> Iterator[None]:
    """These answers of the server are none of our business; `note` is told."""
    try:
        yield
    except ApiStatusError as error:
        if error.status not in allowed:
            raise
        note()
