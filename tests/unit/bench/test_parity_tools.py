"""The tools that judge must be right themselves."""

from pathlib import Path
from random import Random

import pytest
from tests.bench.figures import medians, percentile, ratios, table
from tests.bench.parity import Verdict, differences, weighted
from tests.bench.parity_oracle import OracleLog
from tests.bench.parity_shapes import FAMILIES, pod, scene

LOG = """\
I1121 00:00:00.1 7 schedule_one.go:1] "Plugin scored node for pod" pod="a/p" plugin="NodeAffinity" node="n1" score=20
I1121 00:00:00.1 7 schedule_one.go:1] "Plugin scored node for pod" pod="a/p" plugin="NodeAffinity" node="n2" score=0
I1121 00:00:00.1 7 schedule_one.go:1] "Calculated node's final score for pod" pod="a/p" node="n1" score=320
I1121 00:00:00.1 7 schedule_one.go:1] "Calculated node's final score for pod" pod="a/p" node="n2" score=300
I1121 00:00:00.1 7 round_trippers.go:1] "Response" body="Plugin scored node for pod"
"""


def test_the_log_of_the_oracle_gives_feasible_nodes_scores_and_the_best(tmp_path: Path) -> None:
    path = tmp_path / "log"
    path.write_text(LOG)
    found = OracleLog(path).read()["a/p"]
    assert found.plugins == {"n1": {"NodeAffinity": 20}, "n2": {"NodeAffinity": 0}}
    assert found.best == {"n1"}


def test_a_line_that_is_still_being_written_is_read_when_it_is_complete(tmp_path: Path) -> None:
    path = tmp_path / "log"
    log = OracleLog(path)
    path.write_text(LOG[:130])
    log.read()
    path.write_text(LOG)
    assert len(log.read()["a/p"].totals) == 2


SCORES = {"n1": {"Fit": 90}, "n2": {"Fit": 80}}


@pytest.mark.parametrize(
    ("ours", "found"),
    [
        (Verdict("n1", "", SCORES), ""),
        (Verdict("n2", "", SCORES), "choice"),
        (Verdict("n1", "", {"n1": {"Fit": 90}, "n2": {"Fit": 81}}), "scores of n2"),
        (Verdict("n1", "", {"n1": {"Fit": 90}}), "feasible"),
        (Verdict("", "0/2 nodes are available."), "text"),
    ],
)
def test_every_kind_of_difference_is_found(ours: Verdict, found: str) -> None:
    theirs = Verdict("n1", "", SCORES, best=frozenset({"n1"}))
    problems = differences(theirs, ours)
    assert (found in problems[0]) if found else problems == []


def test_one_space_more_in_a_text_is_a_difference() -> None:
    assert differences(Verdict("", "0/1 nodes"), Verdict("", "0/1  nodes"))


def test_a_plugin_that_scores_nothing_is_the_same_as_one_that_was_skipped() -> None:
    theirs = Verdict("n1", "", {"n1": {"Fit": 90, "ImageLocality": 0}, "n2": {"Fit": 80}}, best=frozenset({"n1"}))
    assert differences(theirs, Verdict("n1", "", SCORES)) == []


def test_weighted_scores_are_read_from_the_columns_of_an_explanation() -> None:
    top = {"nodes": ["n1", "n2"], "weights": {"Taint": 3}, "scores": {"Taint": [100, 50]}}
    assert weighted(top) == {"n1": {"Taint": 300}, "n2": {"Taint": 150}}


def test_equal_seeds_give_equal_scenes_and_pods() -> None:
    one, other = Random(7), Random(7)
    assert scene(one) == scene(other)
    assert [pod(one, "p", "s") for _ in range(50)] == [pod(other, "p", "s") for _ in range(50)]


def test_every_family_turns_up_soon() -> None:
    random = Random(1)
    text = str([pod(random, "p", "s") for _ in range(200)])
    marks = ("example.com/gpu", "hostPort", "initContainers", "metadata.name", "nodeSelector", "tolerations")
    assert len(FAMILIES) >= 10
    assert all(mark in text for mark in marks)


def test_percentiles_medians_and_ratios() -> None:
    assert percentile([5, 1, 3, 2, 4], 50) == 3
    assert percentile([1, 2], 99) == 2
    assert medians([{"a": 1}, {"a": 3}, {"a": 2, "b": 9}]) == {"a": 2, "b": 9}
    assert ratios({"a": 4.0}, {"a": 2.0, "b": 1.0}) == {"a": 2.0}
    assert "1,234" in table({"ours": {"pods/s": 1234.0}})
