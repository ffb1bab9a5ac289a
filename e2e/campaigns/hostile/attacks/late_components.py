"""A tenant whose components are all late keeps the search for better nodes busy, while another's component waits for one."""

import time
from typing import Final

from campaigns.hostile.attack import READY_S, Outcome, judge, register
from campaigns.hostile.bystanders import Bystanders, measure_calm
from campaigns.hostile.intruder import Intruder, Json, intruding
from campaigns.rigs.appwatch import condition
from campaigns.rigs.simulated_site import Object, SimulatedSite, plain_app
from robotapp_api.model.names import Annotation, Label
from robotapp_testbed import wait_until
from robotapp_testbed.machines.network import Topology
from robotapp_testbed.machines.nodes import edge, robot

APPS: Final = 20
COMPONENTS: Final = 48
"""Late ones of each app, 960 in all."""
VICTIM: Final = "amr-1"
CROWD: Final = "amr-2"
EDGES: Final = ("edge-1", "edge-2", "edge-3")
NEAR_MS: Final = 2.0
LATE_MS: Final = 60.0
FOR_S: Final = 1.0
FOUND_S: Final = 3.0
"""A turn is a quarter of a second per namespace; the rest is telemetry and the write."""
OTHERS: Final = 4
PLACED_S: Final = 600.0


def make_nodes() -> Topology:
    """Returns two robots in one hall with three edge servers, which have room for all pods."""
    return Topology([robot(VICTIM), robot(CROWD), *(edge(name, pods=500) for name in EDGES)])


@register("late-components", f"{APPS * COMPONENTS} late components, half of them with when: Never", nodes=make_nodes)
def crowd_the_search(site: SimulatedSite) -> Outcome:
    calm_s = measure_calm(site, "late")
    alone_s = measure_proposal(site, "alone")
    with intruding(site, "late") as intruder:
        for number in range(APPS):
            intruder.create(make_late_app(f"late-{number}", when="Never" if number % 2 else "BudgetExceeded"))
        wait_until(lambda: count_ready(intruder) == APPS, timeout_s=PLACED_S, poll_s=2.0)
        ready_count = count_ready(intruder)
        for name in EDGES:  # no edge server is better, so the search for each of them never ends
            site.telemetry.set_rtt(name, CROWD, LATE_MS)
        wait_until(lambda: count_late(intruder) == APPS, timeout_s=PLACED_S, poll_s=2.0)
        late_count = count_late(intruder)
        with Bystanders(site, "beside-late") as bystanders:
            crowded_s = measure_proposal(site, "crowded")
            bystanders.wait_for_more(OTHERS)
    figures = {
        "late apps not Ready before": float(APPS - ready_count),
        "late apps": float(late_count),
        "better node alone s": alone_s,
        "better node beside them s": crowded_s,
        "others' apps Ready before s": calm_s,
        "others' apps Ready s": bystanders.slowest_s,
    }
    most = {
        "late apps not Ready before": 0,
        "better node beside them s": max(FOUND_S, alone_s),
        "others' apps Ready s": max(READY_S, calm_s),
    }
    return judge(figures, most)


def measure_proposal(site: SimulatedSite, name: str) -> float:
    """Returns the seconds until a component whose budget is exceeded from now on is shown a better node, beyond the time that
    its app lets pass. Infinite when none is shown.
    """
    reschedule = {"when": "BudgetExceeded", "for": f"{FOR_S:g}s"}
    app = plain_app(
        name, parts=(), robots=select_robot(VICTIM), edges=[make_edge("planner")], placement={"reschedule": reschedule}
    )
    app["spec"]["components"] = [make_part("driver", "Robot"), make_part("planner", "Edge")]
    site.create(app)
    site.watch.until_ready(name, within_s=PLACED_S)
    (planner,) = list_pods(site, name, "planner")
    node = planner["spec"]["nodeName"]

    def is_proposed(pod: Object) -> bool:
        """Tells whether a pod has a proposal, or follows one that the operator ended for its proposal."""
        return Annotation.BETTER_NODE in pod["metadata"].get("annotations", {}) or pod["spec"].get("nodeName") != node

    site.telemetry.set_rtt(node, VICTIM, LATE_MS)
    began_s = time.monotonic()
    try:
        has_proposal = wait_until(lambda: any(map(is_proposed, list_pods(site, name, "planner"))), timeout_s=PLACED_S)
        took_s = time.monotonic() - began_s
    finally:
        site.telemetry.set_rtt(node, VICTIM, NEAR_MS)
        site.delete(name)
    return took_s - FOR_S if has_proposal else float("inf")


def make_late_app(name: str, *, when: str) -> Object:
    """Returns an app all of whose components but one are late once the links to its robot are slow."""
    names = [f"c{number}" for number in range(COMPONENTS)]
    placement = {"reschedule": {"when": when, "for": f"{FOR_S:g}s", "maxPerDay": 24}}
    app = plain_app(
        name, parts=(), robots=select_robot(CROWD), edges=[make_edge(name) for name in names], placement=placement
    )
    app["spec"]["components"] = [make_part("driver", "Robot"), *(make_part(name, "Edge") for name in names)]
    app["spec"]["ros2"] = {"rmw": "rmw_cyclonedds_cpp"}
    return app


def make_part(name: str, tier: str) -> Json:
    return {"name": name, "image": "registry.example/part:1", "runsOn": [tier]}


def make_edge(sender: str) -> Json:
    return {"topic": f"/{sender}", "from": sender, "to": "driver", "latency": {"budget": "30ms"}}


def select_robot(name: str) -> Json:
    return {"nodeSelector": {"matchLabels": {Label.ROBOT.value: name}}}


def list_pods(site: SimulatedSite, app: str, component: str) -> list[Object]:
    labels = {Label.APP.value: app, Label.COMPONENT.value: component}
    return [pod for pod in site.pods() if labels.items() <= pod["metadata"].get("labels", {}).items()]


def count_ready(intruder: Intruder) -> int:
    return sum(condition(app, "Ready").get("status") == "True" for app in intruder.list_apps())


def count_late(intruder: Intruder) -> int:
    return sum(condition(app, "BudgetMet").get("status") == "False" for app in intruder.list_apps())
