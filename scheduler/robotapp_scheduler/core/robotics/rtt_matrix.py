"""The RTT model as arrays, for a planner that looks at many rows at once."""

import numpy as np

from robotapp_scheduler.core.nodes.columns import FloatArray
from robotapp_scheduler.core.robotics.rtt import RttModel
from robotapp_scheduler.core.robotics.rtt_estimates import Terms
from robotapp_scheduler.joint.latencies import Latencies


class LatencyExport:
    """Makes `Latencies` of the model, anew when something in it changes."""

    def __init__(self, model: RttModel) -> None:
        self._model = model
        self._latest: tuple[Terms, int, Latencies] | None = None

    def __repr__(self) -> str:
        return f"LatencyExport(of {self._model!r})"

    def latencies(self) -> Latencies:
        """The model as it is now, over all rows of the table."""
        terms = self._model.terms()
        version = self._model.version
        if self._latest is None or self._latest[0] is not terms or self._latest[1] != version:
            fit, measured = terms.fit, self._model.measured()
            found = Latencies(terms.zone, _dense(terms), measured, access_us=fit.access_us, minimum_us=fit.minimum_us)
            self._latest = (terms, version, found)
        return self._latest[2]


def _dense(terms: Terms) -> FloatArray:
    """The time of the path between any two zones, NaN where nothing is measured."""
    table = np.full((2, terms.zones, terms.zones), np.nan)
    near, far = terms.fit.zones
    table[:, near, far] = table[:, far, near] = terms.fit.path_us
    return table
