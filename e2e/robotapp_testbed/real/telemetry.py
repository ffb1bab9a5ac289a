"""A stand-in for the node agents of real nodes: measures the round trips between them and writes NodeTelemetry.

with MeasuredTelemetry(cp) as telemetry:
    cp.switch.set_link("robot-1", "edge-1", delay_ms=20)
    telemetry.measure()

The pings take the way the pods' frames take, through the latency switch, so what is written is what pods meet.
"""

import platform
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from robotapp_testbed.failures import ApiStatusError, TestbedError
from robotapp_testbed.heartbeat import Heartbeat
from robotapp_testbed.real.cluster import RealNodes
from robotapp_testbed.real.node import RealNode
from robotapp_testbed.real.pings import Rtt, figures
from robotapp_testbed.real.prerequisites import required_program
from robotapp_testbed.telemetry import PATH, create, node_uids

_PINGS = 10
_PAUSE_S = 0.05
_ANSWER_S = 2
_PARALLEL = 8


class MeasuredTelemetry:
    """Measures every pair of nodes that are up, each `interval_s` seconds. The objects go with it at the end."""

    def __init__(self, cp: RealNodes, *, interval_s: int = 10) -> None:
        self._cp = cp
        self._interval_s = interval_s
        self._rounds = 0
        self._lock = threading.Lock()
        self._heart = Heartbeat("measured telemetry", self.measure, interval_s=interval_s)

    def __enter__(self) -> Self:
        return self.start()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def start(self) -> Self:
        """The first round is written when this returns."""
        uids = node_uids(self._cp)
        for name in self._cp.nodes:
            create(self._cp, name, uid=uids.get(name, ""), labels={})
        self.measure()
        self._heart.start()
        return self

    def stop(self) -> None:
        """No more rounds; without its agents nobody knows anything of the nodes."""
        self._heart.stop()
        for name in self._cp.nodes:
            with suppress(ApiStatusError):
                self._cp.api.delete(f"{PATH}/{name}")

    def measure(self) -> dict[tuple[str, str], Rtt]:
        """One round now (a second or more, by the longest delay), written; by (from, to)."""
        with self._lock:
            self._rounds += 1
            up = [node for node in self._cp.nodes.values() if node.box.running]
            pairs = [(one, other) for one in up for other in up if one is not other]
            with ThreadPoolExecutor(_PARALLEL) as pool:
                found = dict(zip(pairs, pool.map(_ping, pairs), strict=True))
            for node in up:
                self._write(node.name, {other.name: rtt for (one, other), rtt in found.items() if one is node})
        return {(one.name, other.name): rtt for (one, other), rtt in found.items()}

    def _write(self, name: str, rtts: dict[str, Rtt]) -> None:
        status = {
            "intervalSeconds": self._interval_s,
            "seq": self._rounds,
            "arch": {"x86_64": "amd64", "aarch64": "arm64"}.get(platform.machine(), platform.machine()),
            "kernel": {"realtime": False},
            "devices": [],
            "rtt": [rtt.status(peer, seq=self._rounds) for peer, rtt in rtts.items()],
        }
        self._cp.api.patch(f"{PATH}/{name}/status", {"status": status})


def _ping(pair: tuple[RealNode, RealNode]) -> Rtt:
    origin, target = pair
    argv: list[str | Path] = [
        required_program("busybox"),
        "ping",
        "-c",
        str(_PINGS),
        "-i",
        str(_PAUSE_S),
        "-W",
        str(_ANSWER_S),
    ]
    try:
        return figures(origin.box.run(*argv, target.pod_ip, check=False))
    except (OSError, TestbedError):  # the node crashed meanwhile
        return figures("")
