"""The verdict of `scripts/bench starve`."""

from campaigns.scheduler.starve import judged, told


def turn(cpu: float, p99: float) -> dict[str, float]:
    return {"CPU µs/pod": cpu, "p99 ms": p99}


def test_medians_of_the_turns_are_compared_and_both_targets_named() -> None:
    fine = judged({"idle copy": [turn(100, 1), turn(90, 1), turn(500, 90)], "scheduler": [turn(109, 2), turn(109, 9)]})
    assert fine["missed"] == []
    assert "rises by 9.0 %" in told(fine)
    bad = judged({"idle copy": [turn(100, 1)], "scheduler": [turn(111, 12)]})
    assert [each.partition(",")[0] for each in bad["missed"]] == [
        "CPU per bind rises by 11.0 %",
        "p99 from event to binding rises by 11.0 ms",
    ]
