"""The CPU of a storm is that of all programs it started, those that ended included."""

import os
import subprocess
import sys
import time

from campaigns.storm.campaign import HERE, Cpu

BUSY = "import time\nend = time.process_time() + 0.2\nwhile time.process_time() < end: pass\nprint('x', flush=True)\ninput()"


def test_programs_that_were_killed_stay_counted_and_what_was_used_before_does_not_count() -> None:
    cpu = Cpu(os.getpid())
    cpu.begin()
    busy = subprocess.Popen(
        [sys.executable, "-c", BUSY, "robotapp_scheduler"], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert busy.stdout is not None
    busy.stdout.readline()
    cpu.sample()
    busy.kill()
    busy.communicate()
    cpu.sample()
    used = cpu.by_program()
    assert used["robotapp_scheduler"] >= 0.15
    cpu.begin()
    assert cpu.by_program()["robotapp_scheduler"] == 0.0
    end_s = time.process_time() + 0.1
    while time.process_time() < end_s:
        pass
    cpu.sample()
    assert cpu.by_program()[HERE] >= 0.05
