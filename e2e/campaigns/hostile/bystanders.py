"""Users who do nothing wrong, during an attack: how long their apps take until they are Ready."""

from campaigns.common.background import Background
from campaigns.rigs.journeys import start_one
from campaigns.rigs.simulated_site import SimulatedSite
from robotapp_testbed import wait_until

POOL = "default"
PAUSE_S = 0.5
MOST_S = 90.0
"""How long `wait_for_more` waits for each app."""

WARM_UP_APPS = 2


class Bystanders(Background):
    """Creates one app after the other while it is entered and waits for each; `ready_s` has the seconds of each."""

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
            self.ready_s.append(self._start_one(name))
            self._site.delete(name)

    def _start_one(self, name: str) -> float:
        """Returns the seconds until an app is Ready, infinite where the wait is given up: the other figures of the attack count all the same."""
        try:
            return start_one(self._site, name, POOL)
        except TimeoutError:
            return float("inf")

    def wait_for_more(self, count: int) -> None:
        """Blocks until that many further apps were Ready. Raises what ended the work, or AssertionError when they take too long."""
        target = len(self.ready_s) + count
        if not wait_until(lambda: self._is_at(target), timeout_s=count * MOST_S, poll_s=0.2):
            raise AssertionError(f"{len(self.ready_s)} of {target} apps were Ready within {count * MOST_S:.0f} s")

    def _is_at(self, target: int) -> bool:
        self.check()
        return len(self.ready_s) >= target

    @property
    def slowest_s(self) -> float:
        """The longest time of all; infinite when no app became Ready, so that it cannot pass a limit."""
        return max(self.ready_s, default=float("inf"))


def measure_calm(site: SimulatedSite, name: str, *, apps: int = 4) -> float:
    """Returns the longest time of a few apps without an attack. Where a busy machine takes more than the limit by itself, an attack may not
    make it worse. The first apps of a cold control plane take many times as long and are not counted.
    """
    with Bystanders(site, f"calm-{name}") as calm:
        calm.wait_for_more(WARM_UP_APPS + apps)
    return max(calm.ready_s[WARM_UP_APPS:])
