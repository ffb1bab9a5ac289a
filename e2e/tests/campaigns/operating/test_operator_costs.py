"""When `scripts/bench apply` fails."""

from typing import Any

from campaigns.operating.apply import beside_deployments


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
