"""Settings as Rigel 0.3 hands them to a plugin, laid back onto the Rigelfile, so that messages still name its lines. Pure."""

from collections.abc import Mapping
from typing import Any, Final

from rigel_bridge.document.failures import BridgeError
from rigel_bridge.document.tree import Node
from rigel_bridge.generations.targets import OURS

_KINDS: Final = {bool: "bool", int: "int", float: "float", type(None): "null"}


def planted(value: Any, like: Node) -> Node:
    """`value` as a document node that stands where `like` stands; its parts where the same parts of `like` stand."""
    if isinstance(value, Mapping):
        children = like.value if isinstance(like.value, dict) else {}
        mapping = {
            str(key): planted(child, children.get(str(key)) or _part(like, f".{key}")) for key, child in value.items()
        }
        return Node(mapping, like.place, like.path, "map")
    if isinstance(value, list | tuple):
        items = like.value if isinstance(like.value, list) else []
        sequence = [
            planted(child, items[index] if index < len(items) else _part(like, f"[{index}]"))
            for index, child in enumerate(value)
        ]
        return Node(sequence, like.place, like.path, "seq")
    kind = _KINDS.get(type(value), "str")
    shown = str(value) if kind == "str" else value
    return Node(shown, like.place, like.path, kind, raw=str(value).lower() if kind == "bool" else str(value))


def _part(whole: Node, step: str) -> Node:
    return Node(None, whole.place, f"{whole.path}{step}", "null")


def job_of(root: Node, raw: Mapping[str, Any]) -> str:
    """The job whose settings these are: Rigel does not tell its name, so it is the one that has most of them word for word."""
    jobs = root.mapping().get("jobs")
    own = {name: job for name, job in (jobs.mapping() if jobs else {}).items() if _ours(job)}
    if not own or jobs is None:
        raise _none(root)
    return max(own, key=lambda name: _alike(own[name], raw))


def _none(root: Node) -> BridgeError:
    return root.fail(f"no job has plugin: {OURS[0]}, yet Rigel runs it: is this the Rigelfile that Rigel reads?")


def _ours(job: Node) -> bool:
    named = job.value.get("plugin") if isinstance(job.value, dict) else None
    return named is not None and str(named.value) in OURS


def _alike(job: Node, raw: Mapping[str, Any]) -> int:
    settings = job.mapping().get("with")
    stated = settings.value if settings is not None and isinstance(settings.value, dict) else {}
    return sum(1 if key in raw and _plain(node) == raw[key] else -1 for key, node in stated.items())


def _plain(node: Node) -> Any:
    if isinstance(node.value, dict):
        return {key: _plain(child) for key, child in node.value.items()}
    if isinstance(node.value, list):
        return [_plain(child) for child in node.value]
    return node.value
