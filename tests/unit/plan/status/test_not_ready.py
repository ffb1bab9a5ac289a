"""What the status of an app tells while its robot's node is not Ready and `connectivity.grace` is not over."""

import dataclasses
from typing import Any

from tests.support.factories import make_app

from robotapp_api.model.names import Phase, Reason
from robotapp_claims.rules.instances import Instance
from robotapp_operator.plan.status.components import ComponentView
from robotapp_operator.plan.status.facts import AppFacts, Grace, InstanceFacts
from robotapp_operator.plan.status.status import render_status

GRACE = Grace("2026-01-01T00:00:00Z", "2026-01-01T00:05:00Z", 300.0)
LOST = ComponentView(name="driver", replicas=1, ready=False, exists=True, bound=True, rolling=False, nodes=("n",))
WAITING = dataclasses.replace(LOST, bound=False, nodes=())


def status_of(component: ComponentView, grace: Grace | None = GRACE) -> dict[str, Any]:
    facts = InstanceFacts(
        instance=Instance("amr-07", "n"), components=(component,), domain=7, robot_online=False, grace=grace
    )
    app = make_app(robots={"nodeSelector": {"matchLabels": {"a": "b"}}})
    return render_status(AppFacts(app=app, instances=(facts,), now="2026-01-01T00:00:00Z"))


def test_the_instance_is_degraded_and_told_when_it_will_be_offline() -> None:
    status = status_of(LOST)
    assert (status["phase"], status["instanceCounts"]["offline"]) == (Phase.DEGRADED, 0)
    ready = next(item for item in status["conditions"] if item["type"] == "Ready")
    assert (ready["status"], ready["reason"]) == ("False", Reason.ROBOT_NOT_READY)
    assert "node n of the robot is not Ready since 2026-01-01T00:00:00Z" in ready["message"]
    assert "Offline at 2026-01-01T00:05:00Z (connectivity.grace, 300 s)" in ready["message"]
    assert "is starting" not in ready["message"]
    assert status["summary"]["message"] == ready["message"]
    assert status["troubled"][0]["reason"] == Reason.ROBOT_NOT_READY


def test_after_the_grace_it_is_offline() -> None:
    status = status_of(LOST, grace=None)
    assert (status["phase"], status["instanceCounts"]["offline"]) == (Phase.OFFLINE, 1)


def test_whose_pods_never_found_a_node_is_still_placing() -> None:
    assert status_of(WAITING)["phase"] == Phase.PLACING
