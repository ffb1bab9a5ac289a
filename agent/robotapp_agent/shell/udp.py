"""Probes over UDP: answers those of other nodes, and measures round trips to them."""

from collections.abc import Sequence
from types import TracebackType
from typing import NamedTuple, Self

from robotapp_agent.probe.keys import KeyRing
from robotapp_agent.probe.rounds import Round


class PeerAddress(NamedTuple):
    """Where the agent of a node listens: an IPv4 or IPv6 address without brackets."""

    name: str
    address: str


class UdpProbes:
    """`async with UdpProbes(own_name=node, keys=ring, port=port) as probes: measured = await probes.round(peers, seconds=10)`.

    Answers probes of other nodes on `port` (IPv4 and IPv6) until the block ends. OSError at its beginning when the port cannot be opened.
    """

    def __init__(self, *, own_name: str, keys: KeyRing, port: int) -> None:
        raise NotImplementedError

    async def __aenter__(self) -> Self:
        raise NotImplementedError

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        raise NotImplementedError

    async def round(self, peers: Sequence[PeerAddress], *, seconds: float) -> Round:
        """Ten probes to each of at most 16 peers, spread over `seconds`. Ends after `seconds`. One round at a time."""
        raise NotImplementedError
