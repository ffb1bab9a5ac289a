"""The keys of probes from a mounted Secret: every file of the folder is a key."""

from pathlib import Path

from robotapp_agent.probe.keys import KeyRing


def refresh_keys(ring: KeyRing, folder: Path, *, now_s: float) -> tuple[str, ...]:
    """Bring the ring up to date with the folder. Returns what is wrong with files that were left out, one sentence each.

    Call it about every 10 seconds; `now_s` is any monotonic clock.
    """
    raise NotImplementedError
