"""The control socket of the latency switch: one JSON object per line each way (e2e/latency_switch/control.go)."""

import json
import socket
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from robotapp_testbed.failures import TestbedError
from robotapp_testbed.switch.links import Link, LinkChange, from_state

_TIMEOUT_S = 20.0
_PIECE_BYTES = 65_536


class SwitchRefusedError(TestbedError):
    """The switch says why it does not do what was asked."""


class Control:
    """Each call is a connection of its own: it works from any thread, and over a restart of the switch.

    All methods raise SwitchRefusedError when the switch refuses and OSError when it does not serve.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def __repr__(self) -> str:
        return f"<Control {self.path}>"

    def attach(self, node: str, *, pid: int, tap: str, bridge: str = "") -> None:
        """Make TAP device `tap` in the network namespace of process `pid`, up and in `bridge` when given.

        The port ends with that process. A node that was attached before gets the new port and keeps its links.
        """
        self._ask({"op": "attach", "node": node, "pid": pid, "tap": tap, "bridge": bridge})

    def detach(self, node: str) -> None:
        self._ask({"op": "detach", "node": node})

    def apply(self, changes: Iterable[LinkChange]) -> None:
        """All of them at once, or none when one is refused."""
        self._ask({"op": "set", "links": [change.as_json() for change in changes]})

    def set_link(self, origin: str, target: str, *, one_way: bool = False, **values: float | bool) -> None:
        """New values for fields of Link, both ways unless `one_way`; the other fields stay."""
        self.apply([LinkChange(values, origin=origin, target=target, one_way=one_way)])

    def set_node(self, node: str, **values: float | bool) -> None:
        """The same for all links from and to `node`."""
        self.apply([LinkChange(values, node=node)])

    def nodes(self) -> list[str]:
        """Nodes with a port just now."""
        return list(self._ask({"op": "get"}).get("nodes", ()))

    def known(self) -> list[str]:
        """Nodes that have a port or had one: links can be set for all of them."""
        state = self._ask({"op": "get"})
        ends = {link[end] for link in state.get("links", ()) for end in ("from", "to")}
        return sorted({*state.get("nodes", ()), *ends})

    def links(self) -> dict[tuple[str, str], Link]:
        """By (from, to), of all nodes that were ever attached."""
        return dict(from_state(state) for state in self._ask({"op": "get"}).get("links", ()))

    def metrics(self) -> str:
        """In Prometheus' text format."""
        return str(self._ask({"op": "metrics"})["metrics"])

    def counts(self, metric: str) -> dict[tuple[str, ...], float]:
        """Samples of one metric by the values of its labels, for tests and reports."""
        return samples(self.metrics(), f"latency_switch_{metric}")

    def _ask(self, request: dict[str, Any]) -> dict[str, Any]:
        with socket.socket(socket.AF_UNIX) as connection:
            connection.settimeout(_TIMEOUT_S)
            connection.connect(str(self.path))
            connection.sendall(json.dumps(request).encode() + b"\n")
            answer: dict[str, Any] = json.loads(_line(connection))
        if not answer["ok"]:
            raise SwitchRefusedError(f"latency switch, {request['op']}: {answer['error']}")
        return answer


def samples(text: str, metric: str) -> dict[tuple[str, ...], float]:
    found = {}
    for line in text.splitlines():
        name, _, value = line.rpartition(" ")
        base, _, labels = name.partition("{")
        if base == metric:
            found[tuple(labels.split('"')[1::2])] = float(value)
    return found


def _line(connection: socket.socket) -> bytes:
    text = b""
    while not text.endswith(b"\n"):
        piece = connection.recv(_PIECE_BYTES)
        if not piece:
            raise ConnectionResetError("the latency switch ended while it was asked")
        text += piece
    return text
