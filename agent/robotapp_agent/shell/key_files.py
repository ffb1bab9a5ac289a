"""The keys of probes from a mounted Secret: every file of the folder is a key."""

from pathlib import Path
from typing import Final

from robotapp_agent.probe.keys import MOST_BYTES, KeyRing

_MOST_FILES: Final = 64


def refresh_keys(ring: KeyRing, folder: Path, *, now_s: float) -> tuple[str, ...]:
    """Bring the ring up to date with the folder. Returns what is wrong with files that were left out, one sentence each.

    Call it about every 10 seconds; `now_s` is any monotonic clock. A folder that cannot be read leaves the ring as it is.
    """
    try:
        # The kubelet's own entries (..data and the folder it points to) begin with a dot.
        paths = sorted(path for path in folder.iterdir() if not path.name.startswith("."))
        files = {path.name: _content(path) for path in paths[-_MOST_FILES:] if path.is_file()}
    except OSError as error:
        return (f"the folder of the probe keys cannot be read: {error}",)
    return ring.update(files, now_s=now_s)


def _content(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(MOST_BYTES + 1)
