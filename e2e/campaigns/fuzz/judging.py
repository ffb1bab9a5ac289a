"""What a campaign must keep to: memory that is bounded, loops that are not held, healthy apps that are Ready soon."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from statistics import median
from typing import Final

READY_S: Final = 2.0
"""In half of the cases a healthy app is Ready as soon, on a machine that does nothing else."""
READY_TIMES: Final = 5.0
"""On a busy machine it may take so many times as long as bare Deployments of as many pods, bound by hand, in the same minute.
An app has two discovery servers more, which come first, a claim and a status."""
HELD_S: Final = 1.0
"""For no longer may anything hold the loop of operator or scheduler. Time in which it had no processor does not count."""
BARE_S: Final = 0.85
"""What bare Deployments take beside 5,000 objects on two cores that do nothing else (median). Where they take longer, an answer may, too: not all that keeps a program waiting
on a busy machine is counted by the kernel as waiting for a processor."""
WARM_SHARE: Final = 0.25
"""Share of the objects after which a process has imported, cached and allocated what it needs for any of them."""
KEPT_BYTES: Final = 2048
"""Growth per object that is gone again: an event's text, a key that is forgotten every ten minutes."""
NOISE_BYTES: Final = 16 << 20
"""Growth that says nothing: what the allocator keeps of the lot that was largest so far."""
CACHES_BYTES: Final[Mapping[str, int]] = {"scheduler": 24 << 20}
"""What fills up and has a bound of its own: the scheduler's explain records take 20 MB at most."""
LOTS: Final = 3
"""Memory is the median of as many lots."""


@dataclass(slots=True)
class Samples:
    """Of one process: objects sent so far and bytes in RAM then. `caches_bytes`: of caches that fill up to a bound of their own."""

    caches_bytes: int = 0
    objects: list[int] = field(default_factory=list)
    rss_bytes: list[int] = field(default_factory=list)

    @property
    def warm(self) -> int:
        """How many lots are warm-up."""
        return min(max(1, round(WARM_SHARE * len(self.objects))), max(0, len(self.objects) - 2))

    @property
    def since_warm(self) -> tuple[int, float]:
        """Objects after warm-up, and by how much the process has grown over them."""
        after, last = self.rss_bytes[self.warm :][:LOTS], self.rss_bytes[-LOTS:]
        if not after:
            return 0, 0.0
        return self.objects[-1] - self.objects[self.warm], median(last) - median(after)

    @property
    def allowed_bytes(self) -> int:
        return NOISE_BYTES + self.caches_bytes + KEPT_BYTES * self.since_warm[0]


def memory_problems(samples: Mapping[str, Samples]) -> Iterator[str]:
    for name, found in samples.items():
        objects, grown = found.since_warm
        if grown > found.allowed_bytes:
            yield f"{name} grew by {grown / 1e6:.1f} MB over {objects} objects, allowed are {found.allowed_bytes / 1e6:.1f}"


def time_problems(
    ready_s: Sequence[float], slowest_s: Mapping[str, float], *, bare_s: Sequence[float]
) -> Iterator[str]:
    """`bare_s`: of bare Deployments beside each healthy app. `slowest_s`: the longest that each process took to answer."""
    most_s = max(READY_S, READY_TIMES * median(bare_s)) if bare_s else READY_S
    if ready_s and median(ready_s) > most_s:
        yield f"healthy apps were Ready after {median(ready_s):.2f} s (median), allowed are {most_s:.2f}"
    held_s = HELD_S * max(1.0, median(bare_s) / BARE_S) if bare_s else HELD_S
    for name, seconds in slowest_s.items():
        if seconds > held_s:
            yield f"the {name} took {seconds:.2f} s to answer, allowed are {held_s:.2f}"
