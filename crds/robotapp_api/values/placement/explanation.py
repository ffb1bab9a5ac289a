"""From the scheduler's record of a decision to sentences: which nodes were refused and why, and what keeps a pod waiting.

A record is the JSON of the scheduler's `/explain`. An older scheduler's may lack fields, so it is read as plain JSON.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

from robotapp_api.model.names import ROBOT_END, PodReason
from robotapp_api.values.quantities.duration import parse_us
from robotapp_api.values.replicas import expand_replicas

Json = dict[str, Any]

_PREFIX: Final = "node(s) "
_ESTIMATED: Final = "estimated"
_BY_ESTIMATE: Final = " by estimate"
"""End of a reason whose number was not measured."""
_HARDWARE: Final = "HardwareAffinityFilter"


@dataclass(frozen=True, slots=True)
class Peer:
    """The other end of a latency budget."""

    node: str
    budget_ms: float


def list_budgets(app: Json, component: str, *, instance: str, nodes: Mapping[str, str]) -> tuple[Peer, ...]:
    """Returns what the component must stay near to, from the spec; `nodes` has the nodes of the instance's components."""
    peers: list[Peer] = []
    for edge in expand_replicas(app["spec"]).get("edges") or []:
        ends = (edge["from"], edge["to"])
        budget = _read_milliseconds((edge.get("latency") or {}).get("budget"))
        if component not in ends or budget is None:
            continue
        other = ends[1] if ends[0] == component else ends[0]
        where = instance if other == ROBOT_END else nodes.get(other, "")
        peers.append(Peer(where or other, budget))
    spec = _find_component(app, component)
    budget = _read_milliseconds((spec.get("policies") or {}).get("latencyBudget"))
    if budget is not None and instance:
        peers.append(Peer(instance, budget))
    return tuple(dict.fromkeys(peers))


def describe_hardware(app: Json, component: str) -> str:
    """Returns what the component asks of a node: `can can0, gpu nvidia`; empty without any."""
    spec = _find_component(app, component)
    wishes = [*(spec.get("requires") or []), *(spec.get("devices") or [])]
    words = (" ".join(wish[key] for key in ("type", "model", "interface", "usbID") if wish.get(key)) for wish in wishes)
    return ", ".join(dict.fromkeys(words))


def _find_component(app: Json, name: str) -> Json:
    """Returns its part of the spec; empty for a helper of the app's, which has none."""
    return next((item for item in expand_replicas(app["spec"])["components"] if item["name"] == name), {})


def _read_milliseconds(duration: str | None) -> float | None:
    try:
        return parse_us(duration or "") / 1000
    except ValueError:
        return None


def describe_waiting(record: Json | None, scheduled: Json) -> list[str]:
    """Returns what else than a lack of nodes keeps the pod waiting: others of its group, its predecessor, its domain.

    `scheduled` is the pod's condition PodScheduled. A node that the rules of the pod itself admit (`feasible`) is no use while
    the group is placed whole or not at all.
    """
    if record and record.get("feasible") and not record.get("node") and record.get("message"):
        return [str(record["message"])]
    is_about_nodes = scheduled.get("reason", PodReason.UNSCHEDULABLE) == PodReason.UNSCHEDULABLE
    return [] if is_about_nodes or not scheduled.get("message") else [str(scheduled["message"])]


def describe_refusals(record: Json, peers: tuple[Peer, ...], *, hardware: str = "") -> list[str]:
    """Returns one line per refused node where there is a number, one per reason otherwise; `hardware` is what was asked for."""
    named_peers = tuple(
        Peer(edge["peerNode"], edge["budgetMs"])
        for edge in record.get("edges") or []
        if edge.get("budgetMs") is not None
    )
    lines: list[str] = []
    for refusal in record.get("refusals") or []:
        suffix = f" (asked for: {hardware})" if hardware and refusal.get("plugin") == _HARDWARE else ""
        lines += [f"{line}{suffix}" for line in _list_lines(refusal, named_peers or peers)]
    return lines


def _list_lines(refusal: Json, peers: tuple[Peer, ...]) -> Iterator[str]:
    examples = refusal.get("examples") or []
    reason = str(refusal["reason"]).removeprefix(_PREFIX)
    numbers = [example for example in examples if example.get("number") is not None]
    for example in numbers:
        yield f"{example['node']}: {_describe_number(example, refusal, peers, reason)}"
    names = [str(example["node"]) for example in examples if example not in numbers]
    more = int(refusal["nodes"]) - len(examples)
    if names or more > 0:
        yield f"{_join_names(names, more)}: {reason}"


def _describe_number(example: Json, refusal: Json, peers: Iterable[Peer], reason: str) -> str:
    """Returns `60.0 ms to amr-07 > 30 ms` where the budget it broke is known: the record names it, that of an older scheduler does not."""
    number, unit = example["number"], refusal.get("unit", "")
    if unit == "free":
        return f"{reason}, {_format_amount(number, reason)} free"
    if example.get("peerNode") and example.get("budgetMs") is not None:
        is_guess = example.get("source") == _ESTIMATED
        return _compare(number, [example["peerNode"]], example["budgetMs"], is_guess=is_guess)
    broken_peers = [peer for peer in peers if number > peer.budget_ms] if unit == "ms" else []
    if len({peer.budget_ms for peer in broken_peers}) != 1:  # which of several it broke is not known
        return f"{number:.1f} {unit}, {reason}".replace(" ,", ",")
    nodes = sorted({peer.node for peer in broken_peers})
    return _compare(number, nodes, broken_peers[0].budget_ms, is_guess=reason.endswith(_BY_ESTIMATE))


def _compare(number: float, nodes: list[str], budget_ms: float, *, is_guess: bool) -> str:
    """Returns the time and the budget with as many digits as it takes to see that it is more."""
    texts = (f"{number:.{digits}f}" for digits in (1, 2, 3))
    text = next((text for text in texts if float(text) > budget_ms), f"{number:.6f}")
    return f"{'about ' if is_guess else ''}{text} ms to {' or '.join(nodes)} > {budget_ms:g} ms"


def _format_amount(number: float, reason: str) -> str:
    """Returns cores and GiB: the scheduler counts CPU in thousandths and memory in bytes."""
    resource = reason.partition(",")[0].removeprefix("Insufficient ")
    if resource == "cpu":
        return f"{number / 1000:g}"
    if resource in {"memory", "ephemeral-storage"} or resource.startswith("hugepages-"):
        return f"{number / 2**30:.1f} GiB" if number >= 2**30 else f"{number / 2**20:.0f} MiB"
    return f"{number:g}"


def _join_names(names: list[str], more: int) -> str:
    if more <= 0:
        return ", ".join(names)
    return f"{', '.join(names)} and {more} more" if names else f"{more} nodes"
