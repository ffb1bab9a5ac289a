"""The order of a set of texts is another one in every process. No decision may depend on it, or none could be repeated."""

import os
import subprocess
import sys

PROGRAM = [sys.executable, "-m", "tests.property.core.memory.same_decisions"]


def test_equal_clusters_give_equal_decisions_in_every_process() -> None:
    """Estimated round trips; decisions with their reasons and scores, on single pods and groups; victims; who is tried again."""
    given = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    processes = [
        subprocess.Popen(PROGRAM, env={**given, "PYTHONHASHSEED": seed}, stdout=subprocess.PIPE, text=True)
        for seed in ("1", "2")
    ]
    one, other = (process.communicate()[0].splitlines() for process in processes)
    assert [process.returncode for process in processes] == [0, 0]
    for part in ("round trips", "preempting", "planned together", "DeviceGrant"):
        assert any(part in line for line in one), part
    assert one == other
