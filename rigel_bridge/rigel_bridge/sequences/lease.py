"""The lease of a run on its apps: an annotation that the run renews while its process lives, so that a killed run can be told from a living one."""

import json
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import StrEnum
from typing import Any, Final

from rigel_bridge.cluster import apps
from rigel_bridge.cluster.kubectl import ClusterError, Kubectl
from rigel_bridge.cluster.waiting import Clock
from rigel_bridge.names import APPS, MANAGER, PROVENANCE, RUN_RENEWED

RUN: Final = f"{PROVENANCE}run"
"""On the app of a run: the sequence. Such an app may be removed by the next run; one without it is somebody's."""
RUN_ID: Final = f"{PROVENANCE}run-id"
"""Which run of the sequence the app is of: two people may run the same one, under the same names, at the same time."""
RENEWED: Final = RUN_RENEWED
"""When the run last showed that it lives. A run that ends takes it away, so an app that `--keep` leaves has none."""

RENEW_EVERY_S: Final = 10.0
LEASE_S: Final = 40.0
"""A run without renewal for so long is lost. Both times are those of a kubelet's Lease."""
_FORMAT: Final = "%Y-%m-%dT%H:%M:%SZ"


class State(StrEnum):
    """What is known of the run that made an app."""

    RUNNING = "Running"
    ENDED = "Ended"
    """In order, with `--keep`."""
    LOST = "Lost"
    """Killed, or its machine has no connection to the cluster."""
    UNCLEAR = "Unclear"
    """The renewal is of a later time than now: one of two clocks is wrong."""


@dataclass(slots=True)
class Lease:
    """The apps of one run. Nothing is renewed before `take`."""

    kubectl: Kubectl
    run_id: str
    now: Callable[[], datetime]
    _names: tuple[str, ...] = ()

    def annotations(self, sequence: str) -> dict[str, str]:
        """What an app of the run bears from its creation on."""
        return {RUN: sequence, RUN_ID: self.run_id, RENEWED: self._time()}

    def take(self, names: Sequence[str]) -> None:
        self._names = tuple(names)

    def renew(self) -> None:
        """A renewal that fails is made good by the next one; an app of another run is not touched."""
        self._patch({"op": "add", "path": _pointer(RENEWED), "value": self._time()})

    def release(self) -> None:
        """For apps that stay: the run has ended in order."""
        self._patch({"op": "remove", "path": _pointer(RENEWED)})

    def _patch(self, operation: Mapping[str, str]) -> None:
        if not self._names:
            return
        ours = {"op": "test", "path": _pointer(RUN_ID), "value": self.run_id}
        try:
            self.kubectl.run(
                "patch",
                APPS,
                *self._names,
                f"--field-manager={MANAGER}",
                "--type=json",
                "-p",
                json.dumps([ours, operation]),
            )
        except ClusterError:
            return

    def _time(self) -> str:
        return self.now().astimezone(UTC).strftime(_FORMAT)


@contextmanager
def in_background(work: Callable[[], None]) -> Iterator[None]:
    """Call `work` every RENEW_EVERY_S in a thread of its own, which goes with the process and ends with the block."""
    ended = threading.Event()

    def repeat() -> None:
        while not ended.wait(RENEW_EVERY_S):
            work()

    thread = threading.Thread(target=repeat, daemon=True, name="run-lease")
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def sequence_of(app: Mapping[str, Any]) -> str | None:
    """The sequence whose run made an app; None for an app of no run."""
    return _annotations(app).get(RUN)


def is_of(app: Mapping[str, Any], run_id: str) -> bool:
    """Whether an app is of this run."""
    return _annotations(app).get(RUN_ID, "") == run_id


def state(app: Mapping[str, Any], now: datetime) -> tuple[State, str]:
    """State of the run that made an app by this machine's clock, and a sentence about it."""
    renewed = _annotations(app).get(RENEWED)
    if renewed is None:
        return State.ENDED, "has ended; --keep left the app"
    try:
        age_s = (now - datetime.strptime(renewed, _FORMAT).replace(tzinfo=UTC)).total_seconds()
    except ValueError:
        return State.LOST, f"is lost: {RENEWED} is {renewed[:40]!r}, which is no time"
    if age_s < -LEASE_S:
        return State.UNCLEAR, f"was renewed at {renewed}, which is in the future here: compare the clocks"
    if age_s <= LEASE_S:
        return State.RUNNING, f"goes on, renewed {max(age_s, 0):.0f} s ago"
    lost = f"is lost: not renewed since {renewed}, so it was killed or has no connection"
    return State.LOST, f"{lost}; the next run of the sequence removes the app, and so does `rigel-bridge delete`"


def goes_on(kubectl: Kubectl, app: Mapping[str, Any], *, clock: Clock) -> bool:
    """Whether the run that made an app goes on, which takes up to LEASE_S to find out.

    Only the change of the renewal counts, never its time: the clocks of two machines need not agree.
    """
    renewed = _annotations(app).get(RENEWED)
    if renewed is None:
        return False
    name = app["metadata"]["name"]
    living = False

    def settled() -> bool:
        nonlocal living
        present = apps.read(kubectl, name)
        if present is None or RENEWED not in _annotations(present):  # ended meanwhile
            return True
        living = _annotations(present)[RENEWED] != renewed
        return living

    clock.until(settled, timeout_s=LEASE_S)
    return living


def _annotations(app: Mapping[str, Any]) -> Mapping[str, str]:
    found = app["metadata"].get("annotations")
    return {key: text for key, text in found.items() if isinstance(text, str)} if isinstance(found, dict) else {}


def _pointer(annotation: str) -> str:
    return "/metadata/annotations/" + annotation.replace("~", "~0").replace("/", "~1")
