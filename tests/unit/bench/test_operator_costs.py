"""What the benches of the operator conclude from samples, and the network they shake."""

import json
from pathlib import Path

import pytest
from tests.bench.apply import beside_bare
from tests.bench.reconcile_parts import EVENTS, costs
from tests.support.cpu_samples import Profile, Samples
from tests.support.wobble import Wobbling

from robotapp_testbed.topology import edge, robot

CONTROLLER = "robotapp_operator.reconcile.controller:Controller"


def profile(*stacks: list[object], cpu_s: float = 10.0, calls: dict[str, int] | None = None) -> Profile:
    return Profile({"cpu_s": cpu_s, "calls": calls or {}, "stacks": list(stacks)})


def test_cpu_is_shared_out_by_the_samples_and_each_counts_once() -> None:
    found = profile(
        [5, "main", f"{CONTROLLER}._status", "json:dumps"],
        [3, "main", "robotapp_api.client.transport.stream:data_received", EVENTS],
        [2, "main"],
        calls={EVENTS: 1000},
    )
    cost = costs(found, writes={"PATCH robotapps/status": 4, "PATCH robotappinstances/status": 7}, instances=2)
    parts = {name: seconds for name, seconds in cost["parts_s"].items() if seconds}
    assert parts == {"status of the app": 5.0, "other watch events": 3.0, "other": 2.0}
    assert cost["us_per_watch_event"] == pytest.approx(3000)
    assert cost["ms_per_write_of_a_status"] == pytest.approx(1250)
    assert found.own(1) == {"json:dumps": 5.0}
    assert found.inclusive(1) == {"main": 10.0}


def test_what_was_sampled_is_read_back(tmp_path: Path) -> None:
    samples = Samples()
    samples.stacks["main", "work"] = 3
    samples.calls["place"] = 2
    samples.write(tmp_path / "samples.json")
    found = Profile.read(tmp_path / "samples.json")
    assert (list(found.stacks), found.calls) == ([(3, ["main", "work"])], {"place": 2})
    assert json.loads((tmp_path / "samples.json").read_text())["cpu_s"] == found.cpu_s > 0


def test_times_wobble_within_their_share_alike_in_both_directions() -> None:
    nodes = Wobbling([robot("amr-1"), edge("edge-1"), edge("edge-2", zone="hall-2")])
    pairs = [("amr-1", "edge-1"), ("amr-1", "edge-2"), ("edge-1", "edge-2")]
    calm = [nodes.rtt_ms(*pair) for pair in pairs]
    nodes.wobble(0.2, seed=1)
    shaken = [nodes.rtt_ms(*pair) for pair in pairs]
    assert all(0.8 * one <= other <= 1.2 * one for one, other in zip(calm, shaken, strict=True))
    assert shaken == [nodes.rtt_ms(other, one) for one, other in pairs]
    nodes.wobble(0.2, seed=2)
    assert shaken != [nodes.rtt_ms(*pair) for pair in pairs]


def test_apps_that_take_too_long_beside_bare_deployments_are_a_problem() -> None:
    def result(seconds: float) -> dict[str, dict[str, float]]:
        return {"storm": {"seconds": seconds, "as_many_bare_s": 40.0}, "bare": {"seconds": 20.0}}

    good = result(30.0)
    assert beside_bare(good) == []
    assert good["times_bare"] == {"components": 1.5, "as_many": 0.75}
    assert beside_bare(result(31.0)) == ["apps take 1.55 times as long as bare Deployments"]
    assert beside_bare({"storm": {"seconds": 20.0}}) == []
