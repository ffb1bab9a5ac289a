"""Probes over UDP: answers those of other nodes, and measures round trips to them.

A round trip is timed by the prober's monotonic clock, from right before the request goes to the socket until the prober's kernel
received the reply. What the other agent took to answer is subtracted, at most 1 ms of it: a node that lies about it gains no more.
"""

import asyncio
import errno
import logging
import os
import random
import socket
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from types import TracebackType
from typing import Final, NamedTuple, Self

from robotapp_agent.probe.keys import KeyRing
from robotapp_agent.probe.packets import REPLY, REQUEST, SIZE_BYTES, node_id
from robotapp_agent.probe.peers import MOST_PEERS
from robotapp_agent.probe.prober import Prober
from robotapp_agent.probe.responder import Responder
from robotapp_agent.probe.rounds import Round, RoundSummary, schedule, timeout_s
from robotapp_agent.probe.socket_filter import machine_code, program
from robotapp_agent.shell.datagrams import Address, Datagram, DatagramSocket, Handler, address_of

log = logging.getLogger(__name__)

MOST_STALL_S: Final = 1.0
"""A round in which we were woken later than this, or that the machine slept through, counts for nothing."""
_NO_SUCH_FAMILY: Final = (errno.EAFNOSUPPORT, errno.EPROTONOSUPPORT, errno.EADDRNOTAVAIL)


class PeerAddress(NamedTuple):
    """Where the agent of a node listens: an IPv4 or IPv6 address without brackets."""

    name: str
    address: str


class _Stalled(Exception):  # noqa: N818 - no error: the round is thrown away
    pass


def slept_ns() -> int:
    """How long the machine has been suspended since its start."""
    return time.clock_gettime_ns(time.CLOCK_BOOTTIME) - time.monotonic_ns()


class UdpProbes:
    """`async with UdpProbes(own_name=node, keys=ring, port=port) as probes: measured = await probes.round(peers, seconds=10)`.

    Answers probes of other nodes on `port` (IPv4 and IPv6) until the block ends; its own come from other ports, so that a flood at
    `port` takes none of its replies away. The kernel drops what names none of the keys, if it can. OSError at the beginning when the port cannot be opened.
    """

    def __init__(self, *, own_name: str, keys: KeyRing, port: int, slept_ns: Callable[[], int] = slept_ns) -> None:
        self._keys = keys
        self._port = port
        self._own_id = node_id(own_name)
        self._slept_ns = slept_ns
        self._responder = Responder(own_name=own_name, keys=keys, clock_ns=time.monotonic_ns)
        self._prober = Prober(own_name=own_name, keys=keys, secret=os.urandom(32))
        self._summary = RoundSummary()
        self._answerers: dict[socket.AddressFamily, DatagramSocket] = {}
        self._senders: dict[socket.AddressFamily, DatagramSocket] = {}
        self._timeout_ns = 0
        self._stack = ExitStack()

    def __repr__(self) -> str:
        return f"<UdpProbes port {self._port}, {self._keys!r}, {self._prober!r}, {self._responder!r}>"

    async def __aenter__(self) -> Self:
        with ExitStack() as stack:
            self._answerers = _opened(stack, self._port, self._answer)
            self._senders = _opened(stack, 0, self._take)
            self._filter()
            stack.callback(self._keys.watch(self._filter))
            self._stack = stack.pop_all()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    async def round(self, peers: Sequence[PeerAddress], *, seconds: float) -> Round:
        """Ten probes to each of at most 16 peers, spread over `seconds`. Ends after `seconds`, sooner when it is discarded; a peer
        to which nothing could be sent (no address of a family that this node has) is missing in it. One round at a time.
        """
        targets = self._targets(peers)
        self._timeout_ns = round(timeout_s(seconds) * 1e9)
        began_s, slept_ns = time.monotonic(), self._slept_ns()
        try:
            for offset_s, indices in schedule(len(targets), seconds=seconds, uniform=random.random):
                await self._until(began_s + offset_s, slept_ns)
                for index in indices:
                    self._send(*targets[index])
            await self._until(began_s + seconds, slept_ns)
        except _Stalled as stalled:
            return Round(discarded=str(stalled))
        finally:
            trips = self._prober.finish()
        if self._keys.signing is None:
            return Round(discarded="there is no probe key")
        return self._summary.round(trips)

    def _filter(self) -> None:
        """Let the kernel drop what is not for this node or names none of the present keys."""
        refused: OSError | None = None
        for kind, files in ((REQUEST, self._answerers), (REPLY, self._senders)):
            code = machine_code(program(kind=kind, receiver=self._own_id, key_ids=self._keys.ids))
            for file in files.values():
                refused = file.filter(code) or refused
        if refused:
            log.warning(
                "a flood at UDP port %d can drown the probes: the kernel takes no filter: %s", self._port, refused
            )

    def _targets(self, peers: Sequence[PeerAddress]) -> list[tuple[str, socket.AddressFamily, Address]]:
        by_name = {peer.name: address_of(peer.address, self._port) for peer in peers}
        targets = [(name, *found) for name, found in by_name.items() if found and found[0] in self._senders]
        return targets[:MOST_PEERS]

    async def _until(self, at_s: float, slept_ns: int) -> None:
        await asyncio.sleep(at_s - time.monotonic())
        late_s = time.monotonic() - at_s
        slept_s = (self._slept_ns() - slept_ns) / 1e9
        if slept_s > MOST_STALL_S:
            raise _Stalled(f"the machine was suspended for {slept_s:.0f} s")
        if late_s > MOST_STALL_S:
            raise _Stalled(f"the agent stood still for {late_s:.1f} s")

    def _send(self, peer: str, family: socket.AddressFamily, address: Address) -> None:
        request = self._prober.request(peer)
        if request is None:
            return
        at_ns = self._senders[family].send(request.data, address)
        if at_ns:
            self._prober.sent(request, peer=peer, at_ns=at_ns)

    def _answer(self, came: Datagram) -> bytes | None:
        return self._responder.answer(came.data, source=came.source[0], received_ns=came.received_ns)

    def _take(self, came: Datagram) -> None:
        self._prober.receive(came.data, received_ns=came.received_ns, timeout_ns=self._timeout_ns)


def _opened(stack: ExitStack, port: int, handler: Handler) -> dict[socket.AddressFamily, DatagramSocket]:
    """A socket of each address family that this machine has; at least one."""
    opened = {}
    missing: OSError | None = None
    for family in (socket.AF_INET, socket.AF_INET6):
        try:
            file = DatagramSocket(family, port=port, most_bytes=SIZE_BYTES, handler=handler)
        except OSError as error:
            if error.errno not in _NO_SUCH_FAMILY:
                raise OSError(
                    error.errno, f"UDP port {port} of the probes cannot be opened: {error.strerror}"
                ) from error
            missing = error
        else:
            stack.callback(file.close)
            opened[family] = file
    if missing and not opened:
        raise missing
    return opened
