"""Our histograms say what prometheus_client's would."""

import prometheus_client
import pytest
from hypothesis import given
from hypothesis import strategies as st
from prometheus_client import CollectorRegistry
from prometheus_client.exposition import generate_latest

from robotapp_scheduler.shell.metrics.histogram import Histogram

BUCKETS = [0.001, 0.01, 0.25, 1.0, 16.0]
VALUES = st.one_of(st.sampled_from(BUCKETS), st.floats(min_value=0, max_value=100))
OBSERVED = st.lists(st.tuples(st.sampled_from(["a", 'b\n"c']), VALUES), max_size=30)


def exposed(registry: CollectorRegistry) -> list[str]:
    """Without the times of creation, which we do not keep."""
    lines = generate_latest(registry).decode().splitlines()
    return [line for line in lines if "_created" not in line]


@given(OBSERVED)
def test_what_is_scraped_is_what_prometheus_would_say(observed: list[tuple[str, float]]) -> None:
    ours, theirs = CollectorRegistry(), CollectorRegistry()
    mine = Histogram("wait_seconds", "A text.", labels=["who"], buckets=BUCKETS, registry=ours)
    other = prometheus_client.Histogram("wait_seconds", "A text.", ["who"], buckets=BUCKETS, registry=theirs)
    for who, value in observed:
        mine.labels(who).observe(value)
        other.labels(who).observe(value)
    assert exposed(ours) == exposed(theirs)
    assert sum(mine.counts().values()) == len(observed)


@given(st.lists(VALUES, max_size=20))
def test_without_labels_it_is_there_from_the_start(values: list[float]) -> None:
    ours, theirs = CollectorRegistry(), CollectorRegistry()
    mine = Histogram("wait_seconds", "A text.", labels=(), buckets=BUCKETS, registry=ours)
    other = prometheus_client.Histogram("wait_seconds", "A text.", buckets=BUCKETS, registry=theirs)
    for value in values:
        mine.observe(value)
        other.observe(value)
    assert exposed(ours) == exposed(theirs)


def test_values_that_do_not_fit_the_labels_are_a_bug_and_names_are_taken_once() -> None:
    registry = CollectorRegistry()
    mine = Histogram("wait_seconds", "A text.", labels=["who"], buckets=BUCKETS, registry=registry)
    with pytest.raises(ValueError, match="has the labels"):
        mine.labels("a", "b")
    with pytest.raises(ValueError, match="has the labels"):
        mine.observe(1.0)
    with pytest.raises(ValueError, match="Duplicated"):
        Histogram("wait_seconds", "A text.", labels=["who"], buckets=BUCKETS, registry=registry)
