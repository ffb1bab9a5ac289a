"""The real scheduler process binds pods on the free API server."""

from pathlib import Path

from campaigns.free_api.rig import Rig
from campaigns.scheduler.stub import burst


async def test_the_real_process_binds_every_pod_once_and_writes_an_event_for_each(tmp_path: Path) -> None:
    async with Rig(tmp_path, nodes=30, placed=700) as rig:
        figures = await burst(rig, 120, classes=3)
        found = await rig.report()
        assert (found["bound"], found["rebound"], found["events"], found["nodes_used"]) == (120, 0, 120, 30)
        assert len(found["waited_ms"]) == 120
        assert figures["CPU µs/pod"] > 0
