"""From the scheduler's record to sentences: which nodes were refused, and why."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from robotapp_api.model.names import ROBOT_END
from robotapp_api.values.placement.better_node import TOPIC, edge_to, topic_of
from robotapp_api.values.placement.round_trips import MOVED
from robotapp_cli.commands.apps import MEDIAN
from robotapp_cli.reading.fields import Json, milliseconds, short_ms

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


def budgets(app: Json, component: str, *, instance: str, nodes: Mapping[str, str]) -> tuple[Peer, ...]:
    """What the component must stay near to, from the spec; `nodes` tells where the instance's components are."""
    found: list[Peer] = []
    for edge in app["spec"].get("edges") or []:
        ends = (edge["from"], edge["to"])
        budget = milliseconds((edge.get("latency") or {}).get("budget"))
        if component not in ends or budget is None:
            continue
        other = ends[1] if ends[0] == component else ends[0]
        where = instance if other == ROBOT_END else nodes.get(other, "")
        found.append(Peer(where or other, budget))
    own = _component(app, component)
    if (budget := milliseconds((own.get("policies") or {}).get("latencyBudget"))) is not None and instance:
        found.append(Peer(instance, budget))
    return tuple(dict.fromkeys(found))


def hardware(app: Json, component: str) -> str:
    """What the component asks of a node: `can can0, gpu nvidia`; empty without any."""
    own = _component(app, component)
    wishes = [*(own.get("requires") or []), *(own.get("devices") or [])]
    words = (" ".join(wish[key] for key in ("type", "model", "interface", "usbID") if wish.get(key)) for wish in wishes)
    return ", ".join(dict.fromkeys(words))


def _component(app: Json, name: str) -> Json:
    """Its part of the spec; empty for a helper of the app's, which has none."""
    return next((item for item in app["spec"]["components"] if item["name"] == name), {})


def with_what_is_known(edges: list[Json], records: Mapping[str, Json]) -> list[Json]:
    """The edges of a status with what the scheduler knows by now: the age of the newest measurement, that itself where it is
    another one, and an estimate where there is none. `records`: by component.
    """
    return [edge | _known(edge, records) for edge in edges]


def _known(edge: Json, records: Mapping[str, Json]) -> Json:
    now = _now(edge, records)
    source, rtt_ms = now.get("source"), now.get("rttMs")
    if edge.get("measured"):
        if source != "measured" or now.get("ageS") is None:
            return {}
        return {"ageSeconds": now["ageS"], **_newer(edge, now)}
    if edge.get("p95") or source != "estimated" or rtt_ms is None:
        return {}
    return {"p95": f"{rtt_ms:.3f}ms", "estimated": True, "zones": list(now.get("zones") or ())}


def _newer(edge: Json, now: Json) -> Json:
    """The newest measurement, where the figure of the status is about an older one: that follows once a minute at most."""
    shown_ms, newest_ms = milliseconds(edge.get("p95")), now.get("rttMs")
    if now.get("percentile") == MEDIAN:
        return {"newest": f"median {_ms(newest_ms)}"}
    if shown_ms == newest_ms or (shown_ms and newest_ms is not None and abs(newest_ms - shown_ms) < MOVED * shown_ms):
        return {}
    return {"newest": _ms(newest_ms)}


def _ms(value: float | None) -> str:
    return "unreachable" if value is None else f"{short_ms(value)} ms"


def _now(edge: Json, records: Mapping[str, Json]) -> Json:
    """What the scheduler knows of the nodes of an edge; empty when its records name others."""
    topic = topic_of(str(edge.get("kind", TOPIC)), edge["topic"])
    for own, peer in ((edge["from"], edge["to"]), (edge["to"], edge["from"])):
        record = records.get(own) or {}
        for found in record.get("edges") or []:
            here = {record.get("node"), found.get("peerNode")} == set(edge.get("nodes") or [])
            if here and found.get("what") == edge_to(topic, peer):
                now: Json = found.get("now") or found  # a scheduler of the version before has that of the decision only
                return now | {"percentile": found.get("percentile")}
    return {}


def refusals(record: Json, peers: tuple[Peer, ...], *, wanted: str = "") -> list[str]:
    """One line per refused node where there is a number, one per reason otherwise; `wanted` is the hardware asked for."""
    stated = tuple(
        Peer(e["peerNode"], e["budgetMs"]) for e in record.get("edges") or [] if e.get("budgetMs") is not None
    )
    lines: list[str] = []
    for refusal in record.get("refusals") or []:
        added = f" (asked for: {wanted})" if wanted and refusal.get("plugin") == _HARDWARE else ""
        lines += [f"{line}{added}" for line in _lines(refusal, stated or peers)]
    return lines


def _lines(refusal: Json, peers: tuple[Peer, ...]) -> Iterator[str]:
    examples = refusal.get("examples") or []
    reason = str(refusal["reason"]).removeprefix(_PREFIX)
    measured = [example for example in examples if example.get("number") is not None]
    for example in measured:
        yield f"{example['node']}: {_measured(example, refusal, peers, reason)}"
    others = [str(example["node"]) for example in examples if example not in measured]
    more = int(refusal["nodes"]) - len(examples)
    if others or more > 0:
        yield f"{_names(others, more)}: {reason}"


def _measured(example: Json, refusal: Json, peers: Iterable[Peer], reason: str) -> str:
    """`60.0 ms to amr-07 > 30 ms` where the budget it broke is known: the record names it, that of an older scheduler does not."""
    number, unit = example["number"], refusal.get("unit", "")
    if unit == "free":
        return f"{reason}, {_amount(number, reason)} free"
    if example.get("peerNode") and example.get("budgetMs") is not None:
        guessed = example.get("source") == _ESTIMATED
        return _over(number, [example["peerNode"]], example["budgetMs"], guessed=guessed)
    broken = [peer for peer in peers if number > peer.budget_ms] if unit == "ms" else []
    if len({peer.budget_ms for peer in broken}) != 1:  # which of several it broke is not known
        return f"{number:.1f} {unit}, {reason}".replace(" ,", ",")
    return _over(
        number, sorted({peer.node for peer in broken}), broken[0].budget_ms, guessed=reason.endswith(_BY_ESTIMATE)
    )


def _over(number: float, nodes: list[str], budget_ms: float, *, guessed: bool) -> str:
    """With as many digits as it takes to see that it is more."""
    texts = (f"{number:.{digits}f}" for digits in (1, 2, 3))
    text = next((text for text in texts if float(text) > budget_ms), f"{number:.6f}")
    return f"{'about ' if guessed else ''}{text} ms to {' or '.join(nodes)} > {budget_ms:g} ms"


def _amount(number: float, reason: str) -> str:
    """The scheduler counts CPU in thousandths and memory in bytes; people read cores and GiB."""
    resource = reason.partition(",")[0].removeprefix("Insufficient ")
    if resource == "cpu":
        return f"{number / 1000:g}"
    if resource in {"memory", "ephemeral-storage"} or resource.startswith("hugepages-"):
        return f"{number / 2**30:.1f} GiB" if number >= 2**30 else f"{number / 2**20:.0f} MiB"
    return f"{number:g}"


def _names(names: list[str], more: int) -> str:
    if more <= 0:
        return ", ".join(names)
    return f"{', '.join(names)} and {more} more" if names else f"{more} nodes"
