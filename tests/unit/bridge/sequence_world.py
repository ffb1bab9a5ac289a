"""Runs of sequences against a cluster in memory."""

from pathlib import Path
from typing import Any

from tests.unit.bridge.fake_cluster import FakeCluster

from rigel_bridge.cluster.results import opened
from rigel_bridge.cluster.waiting import Clock
from rigel_bridge.generations.model import Options
from rigel_bridge.sequences.run import Limits, Tools, run
from rigel_bridge.sequences.steps import actions
from rigel_bridge.source import Objects, Source, from_bytes

STEPS = "[{build: {scheduler_name: %s}}, deploy]"
THREE = f"""\
sequences:
  demo: {STEPS % "kubernetes-scheduler"}
  benchmark_default: {STEPS % "default-scheduler"}
  benchmark_custom: {STEPS % "kubernetes-scheduler"}
"""
WISHES = "orchestration: {name: teleop, scheduler: {name: kubernetes-scheduler, policies: {latency_budget: 30ms}}}\n"
LIST = "packages: [{package: teleop, distro: humble, image: 'acme/teleop:1', command: run}]\n" + WISHES + THREE


def read(text: str, sequence: str) -> Objects:
    return from_bytes(text.encode(), Source(Path("Rigelfile"), options=Options(sequence=sequence)))


class SequenceCluster:
    """A cluster whose operator makes every app Ready at once, unless `ready` is false. `built` are Rigel's commands."""

    def __init__(self, *, ready: bool = True) -> None:
        self.cluster = FakeCluster()
        self.ready = ready
        self.built: list[tuple[str, ...]] = []
        self.told: list[str] = []
        self.slept: list[float] = []
        self.cluster.before = self._operate

    def _operate(self, _: tuple[str, ...]) -> None:
        for (kind, _name), stored in self.cluster.objects.items():
            if kind == "robotapps":
                state = {
                    "type": "Ready",
                    "status": str(self.ready),
                    "observedGeneration": stored["metadata"]["generation"],
                }
                stored["status"] = {"conditions": [state]}

    def tools(self, **options: Any) -> Tools:
        now = [0.0]

        def sleep(seconds: float) -> None:
            now[0] += seconds
            self.slept.append(seconds)

        clock = Clock(now_s=lambda: now[0], sleep=sleep)
        limits = Limits(ready_s=5, duration_s=30, removal_s=5)
        return Tools(
            self.cluster, lambda words: self.built.append(tuple(words)), self.told.append, clock, limits, **options
        )

    def run(self, text: str, sequence: str, folder: Path, **options: Any) -> None:
        found = read(text, sequence)
        run(sequence, actions(found.rigelfile, sequence), found, self.tools(**options), opened(folder / sequence))

    def apps(self) -> list[str]:
        return [name for kind, name in self.cluster.objects if kind == "robotapps"]
