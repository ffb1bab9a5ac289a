"""Users who do nothing wrong, during an attack: how long their apps take until they are Ready."""

from campaigns.common.background import Background
from campaigns.rigs.journeys import start_one
from campaigns.rigs.simulated_site import SimulatedSite

POOL = "default"
PAUSE_S = 0.5


class Bystanders(Background):
    """While it is entered, one app after the other is created and waited for; `ready_s` has the seconds of each."""

    def __init__(self, site: SimulatedSite, name: str) -> None:
        super().__init__(f"bystanders of {name}")
        self._site = site
        self._name = name
        self.ready_s: list[float] = []

    def __repr__(self) -> str:
        return f"<Bystanders: {len(self.ready_s)} apps became Ready>"

    def _run(self) -> None:
        while not self._stop.wait(PAUSE_S):
            name = f"{self._name}-{len(self.ready_s)}"
            self.ready_s.append(start_one(self._site, name, POOL))
            self._site.delete(name)

    @property
    def slowest_s(self) -> float:
        """The longest time of all; infinite when no app became Ready, so that it cannot pass a limit."""
        return max(self.ready_s, default=float("inf"))
