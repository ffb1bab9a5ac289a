"""Which domains are claimed, and how many by pool and phase: from the watch of claims."""

from collections import Counter
from collections.abc import Collection, Mapping

from robotapp_api.claims.objects import Claim
from robotapp_scheduler.core.events.cluster_event import Event


class DomainClaims:
    """`see` every event; `counts` is for the metric, `held` for those who look for a free id."""

    def __init__(self) -> None:
        self._claims: dict[str, Claim] = {}
        self._counts: Counter[tuple[str, ...]] = Counter()

    def __repr__(self) -> str:
        return f"<DomainClaims {dict(self._counts)}>"

    def see(self, event: Event) -> None:
        """Count a claim in, out or over; events of other kinds are not ours."""
        if event.resource != "robotclaims":
            return
        for claim, step in ((event.old, -1), (event.new, 1)):
            if isinstance(claim, Claim) and claim.spec.domain is not None:
                self._counts[claim.spec.domain.pool, claim.status.phase] += step
                if step < 0:
                    self._claims.pop(claim.name, None)
                else:
                    self._claims[claim.name] = claim

    def held(self) -> Collection[Claim]:
        """All claims of domains, resting ones included."""
        return self._claims.values()

    def counts(self) -> Mapping[tuple[str, ...], float]:
        """Claims by (pool, phase); 0 where there were some."""
        return {key: float(count) for key, count in self._counts.items()}
