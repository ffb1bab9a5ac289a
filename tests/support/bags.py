"""Bags as the recorder writes them, of messages that need no ROS, and what other readers find in them."""

from pathlib import Path
from random import Random

from rosbags.rosbag2 import Reader

from robotapp_recorder.store import Channel

TOPIC = "/chatter"
CHATTER = Channel(TOPIC, "std_msgs/msg/String", "string data\n", "")


def serialize(number: int, *, size_bytes: int = 16) -> bytes:
    """The CDR of a `std_msgs/msg/String` that begins with the number."""
    head = f"{number}:".encode()
    text = head + Random(number).randbytes(max(0, size_bytes - len(head) - 1)) + b"\0"  # nothing to compress
    return b"\0\1\0\0" + len(text).to_bytes(4, "little") + text


def read_numbers(path: Path) -> list[int]:
    """The numbers of the messages of a closed bag, by the reader of rosbags."""
    with Reader(path) as reader:
        return [int(bytes(data[8:]).split(b":")[0]) for _, _, data in reader.messages()]


def read_all(folder: Path) -> list[int]:
    """The numbers in all closed bags of a folder, the oldest bag first."""
    return [number for path in sorted(folder.glob("*.mcap")) for number in read_numbers(path)]


def total_bytes(folder: Path) -> int:
    """What all files of a folder take."""
    return sum(path.stat().st_size for path in folder.iterdir())
