"""What preemption keeps about nodes from one pod of a class to the next never decides: forgetting it changes nothing."""

from random import Random
from typing import Any

import pytest
from tests.support.scheduling import make_core, make_info, make_node, make_pod

from robotapp_api.model.names import SCHEDULER_NAME

HOSTNAME, ZONE = "kubernetes.io/hostname", "zone"


def away(app: str, key: str) -> dict[str, Any]:
    term = {"topologyKey": key, "labelSelector": {"matchLabels": {"app": app}}}
    return {"podAntiAffinity": {"requiredDuringSchedulingIgnoredDuringExecution": [term]}}


def fields(random: Random, priority: int) -> dict[str, Any]:
    found: dict[str, Any] = {"priority": priority, "labels": {"app": random.choice("ab")}}
    found["cpu"] = random.choice(["500m", "1", "2"])
    if random.random() < 0.3:
        ports = [{"containerPort": 80, "hostPort": random.choice([80, 81])}]
        found["containers"] = [{"name": "c", "resources": {"requests": {"cpu": found["cpu"]}}, "ports": ports}]
    if random.random() < 0.4:
        found["affinity"] = away(random.choice("ab"), HOSTNAME if random.random() < 0.8 else ZONE)
    return found


@pytest.mark.parametrize("seed", range(60))
def test_the_same_victims_with_and_without_what_was_kept(seed: int) -> None:
    random = Random(seed)
    nodes = [make_node(f"n{i}", cpu="3", labels={ZONE: f"z{i % 2}"}) for i in range(6)]
    core = make_core(*nodes)
    for i in range(14):
        core.cluster.apply_pod(make_pod(f"low{i}", node=f"n{i % 6}", **fields(random, random.choice([0, 0, 5]))))
    wishes = [fields(random, 10) for _ in range(2)]
    for step in range(12):
        if random.random() < 0.3:
            more = fields(random, random.choice([0, 20]))
            core.cluster.apply_pod(make_pod(f"more{step}", node=f"n{random.randrange(6)}", **more))
        name, wish = f"high{step}", random.choice(wishes)
        kept = core.schedule_one(make_info(name, **wish), assume=False)
        core.runner(SCHEDULER_NAME)._results._remembered.clear()
        anew = core.schedule_one(make_info(name, **wish), assume=False)
        assert (kept.node, kept.message, kept.nominate, kept.plan) == (
            anew.node,
            anew.message,
            anew.nominate,
            anew.plan,
        )
        if kept.plan is not None and random.random() < 0.7:
            for victim in kept.plan.victims:
                core.cluster.remove_pod(victim.pod)
            core.schedule_one(make_info(name, **wish))
