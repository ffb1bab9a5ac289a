"""What the placement of an instance gave up, as the pods' annotations tell it, for `Placed` with reason FallbackUsed."""

from robotapp_api.model.names import ROBOT_END
from robotapp_api.values.duration import format_us
from robotapp_api.values.given_up import GivenUpEdge, time_text
from robotapp_api.values.round_trips import is_unreachable
from robotapp_operator.plan.spec.text import shown
from robotapp_operator.plan.status.facts import InstanceFacts


def given_up_texts(instance: InstanceFacts) -> list[str]:
    """One sentence per thing. Both ends of an edge may tell of it, and an end that has moved since makes it history."""
    nodes = {component.name: component.nodes for component in instance.components}
    found: dict[tuple[str, ...], str] = {}
    for component in instance.components:
        for given in component.given_up:
            if given.tier:
                text = f"{component.name} runs on tier {given.tier} instead of {shown(given.instead_of)}"
                found.setdefault((component.name,), text)
            for edge in given.edges:
                if edge.peer == ROBOT_END or edge.nodes[1] in nodes.get(edge.peer, ()):
                    ends = sorted((component.name, edge.peer))
                    found.setdefault((edge.edge, *ends), _edge_text(edge, component.name))
    return list(found.values())


def _edge_text(edge: GivenUpEdge, name: str) -> str:
    takes = "is" if is_unreachable(edge.time_us) else "takes"
    time = f"{time_text(edge.time_us)} ({edge.source}, {edge.nodes[0]} to {edge.nodes[1]})"
    return f"{edge.edge} between {name} and {edge.peer} {takes} {time} instead of {format_us(edge.budget_us)}"
