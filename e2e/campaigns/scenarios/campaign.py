"""Repetitions: each draws a cluster, a load and an order, and plays every scenario under both schedulers."""

import random
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Final

from campaigns.rigs.stage import container
from campaigns.scenarios.catalogue import Scenario
from campaigns.scenarios.cluster import Cluster, Json, draw
from campaigns.scenarios.contenders import Running, started
from campaigns.scenarios.promises import refused_bindings
from campaigns.scenarios.promises.place import Place, Verdict
from campaigns.scenarios.watch import ClusterWatch
from robotapp_client.api.resources import DOMAINPOOLS, PODS
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane import product
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.machines.topology import apply, remove

POOL: Final = DOMAINPOOLS.path(None, "default")
NOT_OVER: Final = "it did not come to an end: "


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one scenario under one scheduler. `repetition` and the campaign's seed give it again."""

    repetition: int
    nodes: int
    scenario: str
    contender: str
    verdict: Verdict
    seconds: float


class Campaign:
    """Scenarios on a control plane with our chart installed. `most_nodes` bounds the clusters."""

    def __init__(self, cp: ControlPlane, scenarios: Sequence[Scenario], *, seed: int, most_nodes: int) -> None:
        self._cp = cp
        self._scenarios = scenarios
        self._seed = seed
        self._most_nodes = most_nodes

    def run(self, repetitions: Iterable[int], note: Callable[[Outcome], None]) -> None:
        """Play these repetitions; each outcome is noted as soon as it is there."""
        with ExitStack() as stack:
            stack.enter_context(_short_rest(self._cp))
            stack.enter_context(refused_bindings.policy(self._cp))
            watch = stack.enter_context(ClusterWatch(self._cp.kubeconfig()))
            schedulers = stack.enter_context(started(self._cp))
            operator = product.start_operator(
                self._cp, name="operator-scenarios", sweep_seconds=1, no_leader_election=True
            )
            stack.callback(operator.stop)
            for repetition in repetitions:
                self._repetition(repetition, watch, schedulers, note)

    def _repetition(
        self, repetition: int, watch: ClusterWatch, schedulers: Sequence[Running], note: Callable[[Outcome], None]
    ) -> None:
        rng = random.Random(f"{self._seed}/{repetition}")
        cluster = draw(rng, most_nodes=self._most_nodes, mark=f"scenario-{repetition}")
        order = rng.sample(self._scenarios, len(self._scenarios))
        with _built(self._cp, cluster, f"scenarios-{repetition}") as namespace:
            for scenario in order:
                for running in rng.sample(schedulers, len(schedulers)):
                    if running.contender in scenario.under:
                        place = Place(
                            self._cp,
                            watch,
                            cluster,
                            running=running,
                            namespace=namespace,
                            prefix=f"{scenario.name}-{running.contender.name[0]}",
                            rng=random.Random(f"{self._seed}/{repetition}/{scenario.name}"),
                        )
                        began_s = time.monotonic()
                        verdict = _played(scenario, place)
                        took_s = time.monotonic() - began_s
                        where = repetition, len(cluster.nodes), scenario.name, running.contender.name
                        note(Outcome(*where, verdict=verdict, seconds=took_s))


def _played(scenario: Scenario, place: Place) -> Verdict:
    """The verdict; what does not come to an end keeps none of its promises."""
    try:
        place.until_known()
        return scenario.run(place)
    except TimeoutError as late:
        return Verdict(0, 1, f"{NOT_OVER}{late}")
    finally:
        place.clear()


@contextmanager
def _built(cp: ControlPlane, cluster: Cluster, name: str) -> Iterator[str]:
    """Nodes with their load, and a namespace for the scenarios, whose name is yielded."""
    with ExitStack() as stack:
        stack.callback(remove, cp, cluster.nodes)
        apply(cp, cluster.nodes)
        load = stack.enter_context(created(cp, f"{name}-load"))
        stack.callback(cp.api.delete, f"{PODS.path(load)}?gracePeriodSeconds=0")
        cp.api.each(lambda body: cp.api.create(PODS.path(load), body), _load_pods(cluster))
        yield stack.enter_context(created(cp, name))


def _load_pods(cluster: Cluster) -> list[Json]:
    """A pod on each node that requests the node's load."""
    return [
        {
            "metadata": {"name": f"load-{node}"},
            "spec": {
                "nodeName": node,
                "terminationGracePeriodSeconds": 0,
                "containers": [container(room.requests)],
                "tolerations": [{"operator": "Exists"}],
            },
        }
        for node, room in cluster.load.items()
    ]


@contextmanager
def _short_rest(cp: ControlPlane) -> Iterator[None]:
    """Domains of the default pool rest for one second instead of the shipped sixty."""
    before = cp.api.get(POOL)["spec"].get("quarantineSeconds")
    cp.api.patch(POOL, {"spec": {"quarantineSeconds": 1}})
    try:
        yield
    finally:
        cp.api.patch(POOL, {"spec": {"quarantineSeconds": before}})
