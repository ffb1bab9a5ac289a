"""Which node the agent runs on, as the API server signed it into the token of its service account."""

import base64
import binascii
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

_MOST_BYTES: Final = 64 * 1024


class OwnNode(NamedTuple):
    """`uid` is "" where the token does not tell it: the operator then adds the owner of the NodeTelemetry."""

    name: str
    uid: str = ""


class UnknownNodeError(Exception):
    """The agent cannot know its node; the text tells what to do."""


class _Node(msgspec.Struct):
    name: str = ""
    uid: str = ""


class _Bound(msgspec.Struct):
    node: _Node = msgspec.field(default_factory=_Node)


class _Claims(msgspec.Struct):
    bound: _Bound = msgspec.field(name="kubernetes.io", default_factory=_Bound)


_DECODER: Final = msgspec.json.Decoder(_Claims)


def node_of_token(token: str) -> OwnNode | None:
    """The node that a service account's token is bound to, None when it names none (Kubernetes before 1.32).

    The signature is not checked: the API server does that, and to whom else would the agent lie?
    """
    parts = token.strip().split(".")
    if len(parts) != 3:
        return None
    try:
        payload = base64.urlsafe_b64decode(parts[1] + "=" * (-len(parts[1]) % 4))
        node = _DECODER.decode(payload).bound.node
    except (binascii.Error, ValueError, msgspec.DecodeError):
        return None
    return OwnNode(node.name, node.uid) if node.name else None


def own_node(token_file: Path | None, *, flag: str, environment: str) -> OwnNode:
    """The node of the token, else of the flag, else of the variable NODE_NAME. Raises UnknownNodeError.

    Read it anew before each use: a new token has another uid when the node was made again.
    """
    signed = node_of_token(_read(token_file)) if token_file is not None else None
    named = flag or environment
    if signed is None:
        if not named:
            raise UnknownNodeError(
                "the node's name is unknown: the service account's token names none (Kubernetes before 1.32, or not in a pod). "
                "Set the variable NODE_NAME to spec.nodeName, or use --node-name"
            )
        return OwnNode(named)
    if named and named != signed.name:
        where = "--node-name" if flag else "the variable NODE_NAME"
        raise UnknownNodeError(
            f"{where} is {named}, but the service account's token belongs to a pod on {signed.name}, "
            "and only that node's telemetry may be written with it. Remove the setting"
        )
    return signed


def _read(path: Path) -> str:
    try:
        with path.open("rb") as file:
            return file.read(_MOST_BYTES).decode("ascii", "replace")
    except OSError:
        return ""
