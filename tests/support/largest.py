"""The largest status a RobotAppInstance can have: 64 components, 256 edges, and the longest names everywhere."""

from typing import Any

from tests.support.factories import component, make_app

from robotapp_api.model.names import Reason
from robotapp_api.values.placement.round_trips import RoundTrips
from robotapp_claims.rules.instances import Instance
from robotapp_operator.plan.status.components import MAX_RESTARTS, ComponentView
from robotapp_operator.plan.status.facts import AppFacts, InstanceFacts, of_instance
from robotapp_operator.plan.status.instance_status import render_instance
from robotapp_operator.plan.status.latency import edge_views, worst_first


def largest_status(text: str) -> dict[str, Any]:
    """`text`, many times, is what every message says."""
    names = [f"{number:02}{'c' * 61}" for number in range(64)]
    nodes = [f"{number:02}{'n' * 251}" for number in range(64)]
    topics = [f"/t{number:03}{'t' * 250}" for number in range(256)]
    listed = [
        {
            "kind": "Service",
            "topic": topic,
            "from": names[index % 64],
            "to": names[(index + 1) % 64],
            "latency": {"budget": "999999.999ms"},
        }
        for index, topic in enumerate(topics)
    ]
    app = make_app(*(component(name) for name in names), edges=listed)
    placed = dict(zip(names, nodes, strict=True))
    views = tuple(
        ComponentView(
            name=name,
            replicas=1,
            ready=False,
            exists=True,
            bound=True,
            rolling=True,
            nodes=(placed[name],),
            restarts=MAX_RESTARTS,
            reason=Reason.CRASH_LOOP,
            message=text * 1024,
        )
        for name in names
    )
    found = InstanceFacts(
        instance=Instance("r" * 63, nodes[0]),
        components=views,
        domain=232,
        edges=worst_first(edge_views(app.spec.edges, placed=placed, robot_node="", round_trips=RoundTrips())),
        claims=tuple(f"{number:03}{'d' * 250}" for number in range(200)),
        trouble=(Reason.FAILED_CREATE, text * 4096),
        cut_off=tuple(nodes),
    )
    whole = AppFacts(app=app, instances=(found,), now="2026-01-01T00:00:00Z", bug=text * 4096)
    return render_instance(of_instance(whole, found, previous={}, bug=text * 4096))
