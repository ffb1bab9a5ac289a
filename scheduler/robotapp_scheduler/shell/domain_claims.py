"""How many domains are claimed, by pool and phase: counted from the watch of claims."""

from collections import Counter
from collections.abc import Mapping

from robotapp_api.claims.objects import Claim
from robotapp_scheduler.core.changes import Event


class DomainClaims:
    """`see` every event; `counts` is for the metric."""

    def __init__(self) -> None:
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

    def counts(self) -> Mapping[tuple[str, ...], float]:
        """Claims by (pool, phase); 0 where there were some."""
        return {key: float(count) for key, count in self._counts.items()}
