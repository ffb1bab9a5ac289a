"""Another tenant writes what looks like ours: in a thread of its own, two things a second that name apps of ours."""

import random
from collections.abc import Callable, Collection
from typing import Final

from campaigns.common.background import Background
from campaigns.rigs.simulated_site import SimulatedSite
from campaigns.storm.churn import OVERLOADED, Wish, refusals
from campaigns.storm.wishes import forgery, is_pod

STRANGE: Final = {"deployments": "/apis/apps/v1", "pods": "/api/v1"}
ROUND_S: Final = 1.0
AT_ONCE: Final = 2
CLEARED_AFTER: Final = 20
"""Rounds until all that was forged is taken away."""


class Forger(Background):
    """`with` it, forgeries come. namespace: where all is forged; `wishes` are those of which an app is imitated."""

    def __init__(
        self, site: SimulatedSite, namespace: str, *, chance: random.Random, wishes: Callable[[], Collection[Wish]]
    ) -> None:
        self._site = site
        self._namespace = namespace
        self._chance = chance
        self._wishes = wishes
        super().__init__("forger")
        self.forged = self.refused = 0

    def __repr__(self) -> str:
        return f"<Forger in {self._namespace}: {self.forged}, {self.refused} refused>"

    def clear(self) -> None:
        """Take away all that was forged."""
        for kind, api in STRANGE.items():
            self._site.cp.api.delete(f"{api}/namespaces/{self._namespace}/{kind}")

    def _run(self) -> None:
        rounds = 0
        while not self._stop.wait(ROUND_S):
            rounds += 1
            try:
                self._forge()
                if rounds % CLEARED_AFTER == 0:
                    with refusals(*OVERLOADED):
                        self.clear()
            except OSError:  # an answer that did not come in time; the next round tries again
                continue

    def _forge(self) -> None:
        apps = [name for kind, name in self._wishes() if not is_pod(kind)]
        for name in self._chance.sample(apps, min(AT_ONCE, len(apps))):
            with refusals(404, 409, *OVERLOADED):
                kind, forged = forgery(self._chance, app=self._site.app(name))
                self.forged += 1
                with refusals(403, 422, note=self._note_refused):
                    self._site.cp.api.create(f"{STRANGE[kind]}/namespaces/{self._namespace}/{kind}", forged)

    def _note_refused(self) -> None:
        self.refused += 1
