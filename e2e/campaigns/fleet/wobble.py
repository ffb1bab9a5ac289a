"""A network whose round-trip times all differ from their calm values by some share."""

import zlib

from robotapp_testbed.machines.network import Topology


class Wobbling(Topology):
    """Another factor for every pair after each `wobble`, the same in both directions; nothing is kept per pair."""

    _share = 0.0
    _seed = 0

    def wobble(self, share: float, *, seed: int) -> None:
        """From now on each time lies within `share` of its calm value."""
        self._share, self._seed = share, seed

    def rtt_ms(self, one: str, other: str) -> float:
        calm_ms = super().rtt_ms(one, other)
        if not self._share:
            return calm_ms
        first, second = sorted((one, other))
        chance = zlib.crc32(f"{self._seed} {first} {second}".encode()) / 2**32
        return calm_ms * (1 + self._share * (2 * chance - 1))
