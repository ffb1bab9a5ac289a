"""What the mirror of NodeTelemetry keeps: its round trips are in the model of the pairs, and not a second time in the store."""

from tests.support.scheduling import telemetry

from robotapp_client.api.resources import NODETELEMETRIES
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.watch.routes import robotics_routes


def test_the_model_has_every_pair_and_the_stored_object_none() -> None:
    cluster = Cache(clock=lambda: 0.0)
    route = next(each for each in robotics_routes(cluster) if each.resource == NODETELEMETRIES)
    seen = telemetry("edge-1", rtt_ms={"edge-2": 4.0, "edge-3": 9.0}, load={"cpuPercent": 40})
    assert route.apply(seen)
    assert route.kept is not None
    kept = route.kept(seen)
    assert cluster.rtt.measured_us("edge-2", "edge-1", 50) == 4_000.0
    assert (kept.metadata, kept.status.load, kept.status.rtt) == (seen.metadata, seen.status.load, ())
    assert len(seen.status.rtt) == 2
