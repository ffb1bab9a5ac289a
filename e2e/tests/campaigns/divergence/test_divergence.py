"""A sample of `scripts/bench divergence`: our scheduler meets all budgets that can be met."""

from tests.support.seeds import daily_seed

from campaigns.divergence.divergence import SCHEDULERS, Outcome, Placed, Proof, outcomes, proof, rows
from campaigns.divergence.topology import Machine, Part, Topology, Wire

SAMPLE = 10


def test_ours_meets_every_set_of_budgets_that_highs_proves_feasible() -> None:
    """Other topologies every day; ROBOTAPP_SEED repeats a day, `scripts/bench divergence` has more."""
    found = list(outcomes(daily_seed(), range(SAMPLE)))
    assert [each for each in found if each.missed] == []
    ours, *others = rows(found)
    assert all(ours.edges_met_where_feasible >= other.edges_met_where_feasible for other in others)


def two_nodes(budget_us: int, *, free_milli: int) -> Topology:
    machines = tuple(Machine(name, "z", False, 1000, 1000 - free_milli) for name in ("n1", "n2"))
    parts = (Part("a", 500, "n1"), Part("b", 500, ""))
    p50_us = {("n1", "n2"): 10_000, ("n2", "n1"): 10_000}
    return Topology(machines, parts, (Wire("a", "b", budget_us),), p50_us)


def test_the_proof_knows_budgets_and_capacity() -> None:
    assert proof(two_nodes(13_000, free_milli=500)) is Proof.FEASIBLE
    assert proof(two_nodes(12_999, free_milli=500)) is Proof.INFEASIBLE, "both need a node of their own"
    assert proof(two_nodes(1, free_milli=1000)) is Proof.FEASIBLE
    assert proof(two_nodes(1, free_milli=400)) is Proof.INFEASIBLE


def test_every_scheduler_keeps_capacity_and_ours_rather_waits_than_runs_over_a_budget() -> None:
    for budget_us, free_milli, met in ((13_000, 500, 1), (1_000, 1000, 1), (12_999, 500, 0)):
        topology = two_nodes(budget_us, free_milli=free_milli)
        for name, place in SCHEDULERS.items():
            where = place(topology)
            assert topology.fits(where)
            if name == next(iter(SCHEDULERS)):
                assert (topology.met(where), topology.broken(where)) == (met, 0)
                assert len(where) == 2 * met


def outcome(verdict: Proof, met: int, broken: int = 0, *, overloaded: bool = False) -> Outcome:
    placed = dict.fromkeys(SCHEDULERS, Placed(met, broken, 0))
    return Outcome(0, 2, 2, 1, verdict, placed, overloaded)


def test_what_must_not_be_is_named() -> None:
    assert outcome(Proof.FEASIBLE, 1).missed == outcome(Proof.INFEASIBLE, 0).missed == ""
    assert "does not" in outcome(Proof.FEASIBLE, 0).missed
    assert "impossible" in outcome(Proof.INFEASIBLE, 1).missed
    assert "in time" in outcome(Proof.OPEN, 0).missed
    assert "over its budget" in outcome(Proof.INFEASIBLE, 0, 1).missed
    assert "overloads" in outcome(Proof.FEASIBLE, 1, overloaded=True).missed
