"""Which instances of an app exist: one per robot its selector chooses, one in all, or one for any robot."""

from collections.abc import Iterable

from robotapp_api.claims.identity import hash10
from robotapp_api.claims.objects import LabelSelector
from robotapp_api.model.names import Label


def selector_text(selector: LabelSelector) -> str:
    """The selector as the API server's query parameter takes it, so that the server evaluates it."""
    parts = [f"{key}={value}" for key, value in sorted(selector.match_labels.items())]
    for one in selector.match_expressions:
        values = ",".join(one.values)
        texts = {
            "In": f"{one.key} in ({values})",
            "NotIn": f"{one.key} notin ({values})",
            "Exists": one.key,
            "DoesNotExist": f"!{one.key}",
        }
        parts.append(texts[one.operator])
    return ",".join(parts)


def robot_selector(selector: LabelSelector, robot: str) -> str:
    """Selects the node of `robot`, provided that the app is for it."""
    return ",".join(part for part in (f"{Label.ROBOT}={robot}", selector_text(selector)) if part)


def chosen_instance(uid: str, *, claimed: Iterable[str], deployed: Iterable[str]) -> str | None:
    """`instances: Any`: the robot that has Deployments, else the first in an order everybody computes alike."""
    running = set(deployed)
    robots = sorted(set(claimed) | running, key=lambda robot: (robot not in running, hash10(f"{uid}/{robot}")))
    return robots[0] if robots else None
