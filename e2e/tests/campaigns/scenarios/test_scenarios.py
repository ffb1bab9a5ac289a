"""The thesis' scenarios: what they count as kept, and the table that is made of it."""

from campaigns.scenarios.catalogue import SCENARIOS
from campaigns.scenarios.contenders import KUBE_SCHEDULER, OURS, Contender
from campaigns.scenarios.promises.place import Verdict, judged
from campaigns.scenarios.scenarios import BEGIN, END, Outcome, Report, section
from campaigns.speed.page import DOCS, replaced


def test_a_verdict_names_the_promises_that_were_broken() -> None:
    verdict = judged({"it is red": True, "it is late": False}, waited_ms=3)
    assert (verdict.kept, verdict.of, verdict.reason, verdict.met) == (1, 2, "it is late", False)
    assert judged({"it is red": True}).met


def outcome(scenario: str, contender: Contender, kept: int, **figures: float) -> Outcome:
    verdict = Verdict(kept, 4, "" if kept == 4 else "wanted red", figures)
    return Outcome(repetition=1, nodes=9, scenario=scenario, contender=contender.name, verdict=verdict, seconds=1.0)


def report(*outcomes: Outcome) -> Report:
    return Report("scripts/bench scenarios", {"repetitions": 2, "seed": 5}, {"cores": "2"}, list(outcomes))


def test_the_table_has_runs_and_counts_of_both_schedulers_and_every_miss_of_ours() -> None:
    gpu = SCENARIOS["gpu"]
    found = report(
        outcome("gpu", OURS, 4),
        outcome("gpu", OURS, 3),
        outcome("gpu", KUBE_SCHEDULER, 1),
        outcome("bus-apps", OURS, 4, handover_ms=700),
    )
    text = section(found)
    assert f"| {gpu.text} | 4.4.1 | pods | 1/2 | 7/8 | 0/1 | 1/4 |" in text
    assert f"| {SCENARIOS['bus-apps'].text} | 4.4.4 | promises | 1/1 | 4/4 | - | - |" in text
    assert "bus-apps: the second runs 700 ms after the first was deleted (median), 700 ms at most" in text
    assert "missed: gpu, repetition 1, 9 nodes: wanted red" in text
    assert [each.verdict.kept for each in found.missed] == [3]


def test_the_page_has_a_place_for_the_table() -> None:
    page = replaced((DOCS / "evaluation" / "eo1.md").read_text(), "the table", begin=BEGIN, end=END)
    assert f"{BEGIN}\nthe table\n{END}" in page
