"""Memory of large objects that are gone."""

import subprocess
import sys

import pytest

PROGRAM = """
import sys
from pathlib import Path
from robotapp_client.serving.heap import return_large_objects

def read_rss_bytes():
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096

if int(sys.argv[1]):
    return_large_objects(int(sys.argv[1]))
bytearray(4 << 20)  # glibc now keeps what is smaller
before_bytes = read_rss_bytes()
buffers, small_objects = [], []
for _ in range(100):
    buffers.append(bytearray(b"x") * (256 << 10))
    small_objects.append(bytes(1000))
del buffers
print((read_rss_bytes() - before_bytes) >> 20)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_buffers_between_objects_that_stay_are_given_back() -> None:
    ran = subprocess.run([sys.executable, "-c", PROGRAM, str(128 << 10)], capture_output=True, text=True, check=True)
    assert int(ran.stdout) < 5, "25 MiB were freed"
