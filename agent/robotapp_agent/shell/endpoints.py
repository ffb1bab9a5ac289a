"""The other agents: which nodes have one, in which zone, and at which addresses, from the EndpointSlices of their Service."""

import asyncio
import contextlib
import logging
import socket
from collections.abc import Callable, Collection, Mapping
from typing import Final, NamedTuple

import msgspec

from robotapp_client.api.backoff import Backoff
from robotapp_client.api.client import ApiClient, Page, decoder, with_query
from robotapp_client.api.resources import ENDPOINTSLICES
from robotapp_client.transport.errors import ClientError

log = logging.getLogger(__name__)

SHORTEST_PERIOD_S: Final = 30.0
SECONDS_PER_NODE: Final = 0.12
"""All agents together read the list eight times per second, whatever the size of the cluster, also when all have just started:
with 5000 nodes it has 1.6 MB.
"""
SOONEST_S: Final = 10.0
SOONEST_PER_NODE_S: Final = 0.04
"""From one reading to the next when there is a reason to read it sooner."""
SOONER_PER_NODE_S: Final = 0.03
"""The longest wait of an agent with such a reason: all of them may have it at the same moment."""
JITTER: Final = 0.2
SLOWEST_RETRY_S: Final = 300.0
PAGE: Final = 500
MOST_NODES: Final = 20_000
MOST_ADDRESSES: Final = 4
_MOST_NAME: Final = 253
_PER_SLICE: Final = 100
"""Endpoints that Kubernetes puts into a slice by default."""


class Peer(NamedTuple):
    """The agent of a node. IPv4 and IPv6 addresses as text, in the order of the slices; `zone` is "" for none."""

    zone: str
    addresses: tuple[str, ...]


class _Conditions(msgspec.Struct):
    ready: bool | None = None
    terminating: bool | None = None


class _Endpoint(msgspec.Struct, rename="camel"):
    addresses: list[str] | None = None
    conditions: _Conditions | None = None
    node_name: str | None = None
    zone: str | None = None


class _Slice(msgspec.Struct, rename="camel"):
    endpoints: list[_Endpoint] | None = None


class _Counted(msgspec.Struct, rename="camel"):
    remaining_item_count: int = 0


class _FirstPage(msgspec.Struct):
    metadata: _Counted
    items: list[_Slice] | None = None


_FIRST: Final = msgspec.json.Decoder(_FirstPage)
_PAGE: Final = Page[_Slice]


class Endpoints:
    """The peers as last read; an API server that does not answer changes nothing."""

    def __init__(
        self,
        client: ApiClient,
        *,
        namespace: str,
        service: str,
        uniform: Callable[[], float],
    ) -> None:
        self._client = client
        self._all = ENDPOINTSLICES.path(namespace)
        self._path = with_query(self._all, {"labelSelector": f"kubernetes.io/service-name={service}"})
        self._uniform = uniform
        self.changed: Callable[[], None] = lambda: None
        """Called after each list."""
        self._sooner = asyncio.Event()
        self._missing: set[str] = set()
        """Nodes that were looked for and have no agent."""
        self.peers: Mapping[str, Peer] = {}
        """By name of the node, the own one included. Replaced as a whole."""
        self.nodes = 0
        """Nodes with an agent; before the first list an upper bound, or 0 while nothing is known."""

    def __repr__(self) -> str:
        return f"<Endpoints: {len(self.peers)} peers>"

    async def count(self) -> int:
        """About how many nodes there are, by one small request. Raises ClientError.

        Without a selector, with which the API server does not tell how many slices remain: the namespace is the agents' own.
        """
        page = await self._client.read(with_query(self._all, {"limit": "1"}), _FIRST.decode)
        known = len(page.items[0].endpoints or ()) if page.items else 0
        self.nodes = (
            known
            if page.metadata.remaining_item_count <= 0
            else ((1 + page.metadata.remaining_item_count) * _PER_SLICE)
        )
        return self.nodes

    def look_for(self, names: Collection[str]) -> None:
        """Read the list sooner when one of these nodes is not in it; once only for a node that then is not in it either."""
        missing = {name for name in names if name not in self.peers}
        if missing - self._missing:
            self._sooner.set()
        self._missing = missing

    def look_again(self) -> None:
        """Read the list sooner: an agent that answers no longer may have another address."""
        self._sooner.set()

    async def run(self) -> None:
        """Read the list again and again, first at a random moment of a period."""
        backoff = Backoff(base_s=2.0, cap_s=SLOWEST_RETRY_S, uniform=self._uniform)
        await self._rest(SECONDS_PER_NODE * self.nodes * self._uniform())
        while True:
            self._sooner.clear()
            try:
                await self.refresh()
            except (ClientError, msgspec.ValidationError) as error:
                wait_s = backoff.next_s()
                log.warning(
                    "cannot list the other agents, the last list stays in use; next try in %.0f s: %s", wait_s, error
                )
                await asyncio.sleep(wait_s)
                continue
            backoff.reset()
            await self._pause()

    async def refresh(self) -> None:
        """Read the list once, from the API server's cache. Raises ClientError."""
        found: dict[str, Peer] = {}
        path = with_query(self._path, {"resourceVersion": "0"})
        async for page, again in self._client.pages(path, decoder(_PAGE).decode, page=PAGE):
            if again:
                found = {}
            for each in page.items or ():
                _take(found, each.endpoints or ())
        self.peers = found
        self.nodes = len(found)
        self.changed()

    async def _pause(self) -> None:
        soonest_s = max(SOONEST_S, SOONEST_PER_NODE_S * self.nodes)
        period_s = max(SHORTEST_PERIOD_S, SECONDS_PER_NODE * self.nodes)
        stretch = 1 + JITTER * self._uniform()
        await asyncio.sleep(soonest_s * stretch)
        await self._rest((period_s - soonest_s) * stretch)

    async def _rest(self, longest_s: float) -> None:
        """Wait, but not for long once there is a reason to read sooner."""
        if longest_s <= 0:
            return
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(longest_s):
                await self._sooner.wait()
                await asyncio.sleep(SOONER_PER_NODE_S * self.nodes * self._uniform())


def _take(found: dict[str, Peer], endpoints: list[_Endpoint] | tuple[()]) -> None:
    """Add a slice's endpoints. During an update a node has two agents: one that ends stands behind the other."""
    for endpoint in endpoints:
        name = endpoint.node_name or ""
        addresses = tuple(text for text in (endpoint.addresses or ())[:MOST_ADDRESSES] if is_address(text))
        if not addresses or not 0 < len(name) <= _MOST_NAME:
            continue
        old = found.get(name)
        if old is None:
            if len(found) < MOST_NODES:
                found[name] = Peer(endpoint.zone or "", addresses)
            continue
        ends = endpoint.conditions is not None and endpoint.conditions.terminating
        both = old.addresses + addresses if ends else addresses + old.addresses
        found[name] = Peer(old.zone or endpoint.zone or "", tuple(dict.fromkeys(both))[:MOST_ADDRESSES])


def is_address(text: str) -> bool:
    """Whether the text is an IPv4 or IPv6 address without a zone."""
    for family in (socket.AF_INET, socket.AF_INET6):
        try:
            socket.inet_pton(family, text)
        except (OSError, ValueError):  # ValueError: a zero byte
            continue
        return True
    return False
