"""What was so, and when: sentences about the past are judged by it, because the cluster itself has only the present."""

import threading
from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any, Final, Self

from campaigns.common.background import Background
from campaigns.rigs.simulated_site import APIS, Object, SimulatedSite
from robotapp_api.model.names import Label

EVERY_S: Final = 0.3
LATE: Final = timedelta(seconds=5)
"""What is told may be seen by this history a little later than by the program that tells it."""


@dataclass(slots=True)
class Span:
    """A fact was seen so in all looks from the first moment to the last."""

    first: datetime
    last: datetime


class History(Background):
    """Looks at pods, claims, nodes and telemetry while it is open, and remembers the spans of their facts.

    Facts are tuples: ("pod", component, node), ("claim", holder, domain id or "device on node"), ("rtt", node, peer, ms),
    ("device", node, id, present), ("ready", node, status), ("robot", name, node), ("cordoned", node).
    """

    def __init__(self, site: SimulatedSite) -> None:
        self._site = site
        self._spans: dict[Hashable, list[Span]] = {}
        self._at = datetime.now(UTC)
        self._lock = threading.Lock()
        super().__init__("history")

    def __enter__(self) -> Self:
        self.look()
        return super().__enter__()

    def was(self, *fact: Hashable, at: datetime, within_s: float = 0.0) -> bool:
        """Was it so at that time, or up to so many seconds before? `...` in a fact stands for anything."""
        since = at - timedelta(seconds=within_s) - LATE
        return any(span.first <= at + LATE and span.last >= since for span in self._of(fact))

    def ever(self, *fact: Hashable, until: datetime) -> bool:
        """Was it so at any time before?"""
        return any(span.first <= until + LATE for span in self._of(fact))

    def facts(self, *fact: Hashable, until: datetime) -> list[tuple[Any, ...]]:
        """All facts of this form that were ever so before."""
        with self._lock:
            found = [key for key in self._spans if _fits(key, fact)]
            return [key for key in found if any(span.first <= until + LATE for span in self._spans[key])]  # type: ignore[misc]

    def look(self) -> None:
        """Take in how things are."""
        api = self._site.cp.api
        now = datetime.now(UTC)
        pods, claims = self._site.pods(), api.get(f"{APIS}/robotclaims")["items"]
        nodes, reports = api.get("/api/v1/nodes")["items"], api.get(f"{APIS}/nodetelemetries")["items"]
        with self._lock:
            before, self._at = self._at, now
            for fact in (*_of_pods(pods), *_of_claims(claims), *_of_nodes(nodes), *_of_reports(reports)):
                spans = self._spans.setdefault(fact, [])
                if spans and spans[-1].last >= before:
                    spans[-1].last = now
                else:
                    spans.append(Span(now, now))

    def _of(self, fact: tuple[Hashable, ...]) -> list[Span]:
        with self._lock:
            if ... not in fact:
                return list(self._spans.get(fact, ()))
            return [span for key, spans in self._spans.items() if _fits(key, fact) for span in spans]

    def _run(self) -> None:
        while not self._stop.wait(EVERY_S):
            try:
                self.look()
            except (OSError, TimeoutError):  # a look less: the next one comes at once
                continue


def _fits(key: Hashable, fact: tuple[Hashable, ...]) -> bool:
    return (
        isinstance(key, tuple)
        and len(key) == len(fact)
        and all(want in (..., have) for have, want in zip(key, fact, strict=True))
    )


def _of_pods(pods: list[Object]) -> Iterator[Hashable]:
    for pod in pods:
        meta, node = pod["metadata"], pod["spec"].get("nodeName")
        labels: Mapping[str, str] = meta.get("labels", {})
        if node:
            yield "pod", labels.get(Label.COMPONENT, ""), node
            yield "uid", meta["uid"], node


def _of_claims(claims: list[Object]) -> Iterator[Hashable]:
    for claim in claims:
        spec = claim["spec"]
        holder = f"{spec['holder']['namespace']}/{spec['holder']['name']}"
        device = spec.get("device")
        yield "claim", holder, f"{device['id']} on {device['node']}" if device else spec["domain"]["id"]


def _of_nodes(nodes: list[Object]) -> Iterator[Hashable]:
    for node in nodes:
        name, labels = node["metadata"]["name"], node["metadata"].get("labels", {})
        ready = [each["status"] for each in node["status"].get("conditions", ()) if each["type"] == "Ready"]
        yield "node", name
        yield "ready", name, ready == ["True"]
        if robot := labels.get(Label.ROBOT):
            yield "robot", robot, name
        if node["spec"].get("unschedulable"):
            yield "cordoned", name
        for taint in node["spec"].get("taints", ()):
            yield "taint", name, taint["key"]


def _of_reports(reports: list[Object]) -> Iterator[Hashable]:
    for report in reports:
        name, status = report["metadata"]["name"], report.get("status", {})
        for entry in status.get("rtt", ()):
            for percentile in ("p50Us", "p95Us"):
                ms = entry[percentile] / 1000 if percentile in entry else None
                yield "rtt", name, entry["peer"], ms
                yield "rtt", entry["peer"], name, ms
        for device in status.get("devices", ()):
            yield "device", name, device["id"], device["present"]
