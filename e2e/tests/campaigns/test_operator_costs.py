"""What the benches of the operator conclude from samples, and the network they shake."""

import json
from pathlib import Path
from typing import Any

import pytest

from campaigns.fleet.fleet import Wobbling
from campaigns.operating.apply import beside_deployments
from campaigns.operating.reconcile_parts import EVENTS, costs
from campaigns.scheduler.cpu_samples import Profile, Samples
from robotapp_testbed.machines.topology import edge, robot

CONTROLLER = "robotapp_operator.reconcile.controller:Controller"


def profile(*stacks: list[object], cpu_s: float = 10.0, calls: dict[str, int] | None = None) -> Profile:
    return Profile({"cpu_s": cpu_s, "calls": calls or {}, "stacks": list(stacks)})


def test_cpu_is_shared_out_by_the_samples_and_each_counts_once() -> None:
    found = profile(
        [5, "main", f"{CONTROLLER}._status", "json:dumps"],
        [3, "main", "robotapp_client.transport.stream:data_received", EVENTS],
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


def test_apps_that_take_too_long_beside_their_deployments_applied_by_hand_are_a_problem() -> None:
    def result(storm_s: float, peers_s: float) -> dict[str, Any]:
        return {
            "storm": {"seconds": storm_s, "by_hand_s": 40.0},
            "peers": {"seconds": peers_s, "by_hand_s": 24.0},
            "bare": {"seconds": 20.0},
        }

    good = result(60.0, 36.0)
    assert beside_deployments(good) == []
    assert good["times"] == {"storm": {"by_hand": 1.5, "bare": 3.0}, "peers": {"by_hand": 1.5, "bare": 1.8}}
    what = "times as long as their Deployments applied by hand"
    assert beside_deployments(result(62.0, 30.0)) == [f"storm: apps take 1.55 {what}"]
    assert beside_deployments(result(60.0, 48.0)) == [f"peers: apps take 2.00 {what}"]
    alone: dict[str, Any] = {"storm": {"seconds": 30.0, "by_hand_s": 20.0}}
    assert beside_deployments(alone) == []
    assert alone["times"] == {"storm": {"by_hand": 1.5}}
