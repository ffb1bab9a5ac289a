"""Lists the folder of a recording, as `kubectl robotapp bags` reads it."""

from pathlib import Path
from typing import Any

from mcap.reader import make_reader

from robotapp_recorder.store import CLOSED, OPEN


def list_bags(folder: Path) -> list[dict[str, Any]]:
    """Returns name, size and state of each bag, the oldest first; none where nothing was recorded yet."""
    paths = (path for path in sorted(folder.glob("*")) if path.name.endswith((CLOSED, OPEN)))
    return [
        {"name": path.name, "bytes": path.stat().st_size, "state": "closed" if path.suffix == CLOSED else "open"}
        for path in paths
    ]


def read_info(path: Path) -> dict[str, Any]:
    """Returns times, and the messages of each topic. An open bag has no index yet. Raises ValueError for it."""
    if not path.name.endswith(CLOSED):
        raise ValueError(f"{path.name} is being written: its topics are listed when it is closed")
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    if summary is None or summary.statistics is None:
        raise ValueError(f"{path.name} has no index")
    statistics = summary.statistics
    topics = [
        {
            "topic": channel.topic,
            "type": summary.schemas[channel.schema_id].name if channel.schema_id in summary.schemas else "",
            "messages": statistics.channel_message_counts.get(channel.id, 0),
        }
        for channel in sorted(summary.channels.values(), key=lambda channel: channel.topic)
    ]
    return {
        "name": path.name,
        "bytes": path.stat().st_size,
        "messages": statistics.message_count,
        "beganNs": statistics.message_start_time,
        "endedNs": statistics.message_end_time,
        "topics": topics,
    }
