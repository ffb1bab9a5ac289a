"""Figures from the CSV files that containers leave."""

import statistics as reference
from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigel_bridge.sequences import samples
from rigel_bridge.sequences.samples import columns, statistics


@given(st.lists(st.floats(0, 1e6), min_size=1, max_size=200))
def test_statistics_are_those_of_the_textbook(values: Sequence[float]) -> None:
    found = statistics(values)
    assert found["count"] == len(values)
    assert found["mean"] == pytest.approx(reference.fmean(values))
    assert found["std"] == pytest.approx(reference.pstdev(values), rel=1e-6, abs=1e-6)
    assert found["p99"] in values
    assert found["p50"] <= found["p95"] <= found["p99"] <= max(values)


def test_columns_with_a_unit_of_time_are_samples_and_nothing_else_is() -> None:
    found = columns(b"stamp,rtt_ms,note\n1,2.0,a\n2,4.0,b\n3,nan,c\n4\n5,x,d\n")
    assert found == {"rtt_ms": {"count": 2, "mean": 3.0, "std": 1.0, "p50": 2.0, "p95": 4.0, "p99": 4.0}}
    for content in (b"", b"\xff\xfe", b"a,b\n1,2\n", b"rtt_ms\n", b"\x00"):
        assert columns(content) == {}


@pytest.mark.parametrize(
    "content", [b"a_ms\n1e308\n1e308\n1\n", b"a_ms\n1e200\n-1e200\n1\n", b"a_ms\n1e999\n-inf\n1\n"]
)
def test_values_that_are_no_times_end_no_run(content: bytes) -> None:
    assert columns(content)["a_ms"]["count"] == 1


def test_a_wide_or_long_file_of_samples_is_read_up_to_a_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    wide = ",".join(f"c{number}_ms" for number in range(1000))
    assert len(columns(f"{wide}\n{','.join('1' * 1000)}\n".encode())) == samples.MAX_COLUMNS
    monkeypatch.setattr(samples, "MAX_VALUES", 10)
    assert columns(b"a_ms,b_ms\n" + b"1,2\n" * 100)["b_ms"]["count"] == 5
