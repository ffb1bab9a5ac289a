"""Histograms that cost a quarter of a microsecond to observe: kept as plain numbers, put into words when scraped.

prometheus_client's own take a lock twice per observation. All of ours are observed and scraped in the event loop's thread.
"""

from bisect import bisect_left
from collections.abc import Iterable, Sequence
from itertools import accumulate
from typing import Final

from prometheus_client import CollectorRegistry
from prometheus_client.core import HistogramMetricFamily, Metric
from prometheus_client.registry import Collector
from prometheus_client.utils import floatToGoString

INFINITE: Final = float("inf")


class Tally:
    """Observations under one set of label values."""

    __slots__ = ("_bounds", "counts", "total")

    def __init__(self, bounds: Sequence[float]) -> None:
        self._bounds = bounds
        self.counts = [0] * len(bounds)
        self.total = 0.0

    def __repr__(self) -> str:
        return f"<Tally of {self.count} observations>"

    @property
    def count(self) -> int:
        return sum(self.counts)

    def observe(self, value: float) -> None:
        """Count `value` in the first bucket that holds it."""
        self.counts[bisect_left(self._bounds, value)] += 1
        self.total += value


class Histogram(Collector):
    """One family. `labels` gives the tally of one set of values; a histogram without labels has one from the start."""

    def __init__(
        self, name: str, text: str, *, labels: Sequence[str], buckets: Sequence[float], registry: CollectorRegistry
    ) -> None:
        self._name, self._text, self._labels = name, text, tuple(labels)
        self.bounds: Final = (*buckets, INFINITE)
        self._words = [floatToGoString(bound) for bound in self.bounds]  # type: ignore[no-untyped-call]
        self._tallies: dict[tuple[str, ...], Tally] = {} if labels else {(): Tally(self.bounds)}
        registry.register(self)

    def __repr__(self) -> str:
        return f"<Histogram {self._name} of {len(self._tallies)} series>"

    def labels(self, *values: str) -> Tally:
        """What is observed under these values; keep it where it is needed often."""
        found = self._tallies.get(values)
        if found is None:
            if len(values) != len(self._labels):
                raise ValueError(f"{self._name} has the labels {self._labels}, not {values}")
            found = self._tallies[values] = Tally(self.bounds)
        return found

    def observe(self, value: float) -> None:
        """Only without labels."""
        self.labels().observe(value)

    def counts(self) -> dict[tuple[str, ...], float]:
        """How much was observed, by label values."""
        return {values: float(tally.count) for values, tally in self._tallies.items()}

    def describe(self) -> Iterable[Metric]:
        return [HistogramMetricFamily(self._name, self._text, labels=self._labels)]

    def collect(self) -> Iterable[Metric]:
        family = HistogramMetricFamily(self._name, self._text, labels=self._labels)
        for values, tally in self._tallies.items():
            buckets = list(zip(self._words, map(float, accumulate(tally.counts)), strict=True))
            family.add_metric([str(value) for value in values], buckets, sum_value=tally.total)
        return [family]
