"""A recorder that is killed while it writes: the next one completes its bag, which has all but the open chunk."""

import subprocess
import sys
from pathlib import Path
from random import Random

from tests.support.bags import read_all, total_bytes

from robotapp_recorder.store import BagStore, Limits

KILLS = 20
MESSAGE_BYTES = 512
LIMITS = Limits(split_bytes=128 << 10, retain_bytes=512 << 10)
CHUNK_BYTES = LIMITS.split_bytes // 4
ROOT = Path(__file__).resolve().parents[3]
PROGRAM = """\
import os, sys
from pathlib import Path
from tests.support.bags import CHATTER, TOPIC, serialize
from robotapp_recorder.store import BagStore, Limits
store = BagStore(Path(sys.argv[1]), "run", Limits(int(sys.argv[2]), int(sys.argv[3])))
store.open()
store.add_channel(CHATTER)
number = int(sys.argv[4])
while True:
    store.add_message(TOPIC, serialize(number, size_bytes=int(sys.argv[5])), published_ns=0)
    os.write(1, b"%d\\n" % number)
    number += 1
"""


def record_until_killed(folder: Path, first: int, count: int) -> int:
    """Starts a recorder, kills it once it has written so many messages, and returns the last that it is known to have written."""
    limits = [str(LIMITS.split_bytes), str(LIMITS.retain_bytes), str(first), str(MESSAGE_BYTES)]
    program = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, str(folder), *limits], stdout=subprocess.PIPE, cwd=ROOT, text=True
    )
    assert program.stdout is not None
    with program.stdout as lines:
        for line in lines:
            if int(line) >= first + count:
                program.kill()
        program.wait()
    return int(line)


def test_twenty_kills_lose_at_most_the_open_chunk_each_and_every_bag_opens(tmp_path: Path) -> None:
    random, first = Random(42), 0
    for _ in range(KILLS):
        last = record_until_killed(tmp_path, first, random.randint(1, 900))
        store = BagStore(tmp_path, "run", LIMITS)
        store.open()
        kept = read_all(tmp_path)
        assert kept == sorted(set(kept)), "no message twice, and the order of their sending"
        this_life = [number for number in kept if number >= first]
        newest = max(this_life, default=first - 1)
        assert this_life == list(range(newest - len(this_life) + 1, newest + 1)), "no gap"
        assert (last - newest) * MESSAGE_BYTES <= CHUNK_BYTES + MESSAGE_BYTES, "only the open chunk is lost"
        assert total_bytes(tmp_path) <= LIMITS.retain_bytes + LIMITS.split_bytes
        first = last + 2
