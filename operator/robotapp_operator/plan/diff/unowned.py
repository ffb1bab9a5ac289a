"""Domain variables that another writer put into a template of ours.

Server-side apply never removes another manager's variable, and such a template names a domain its instance does not
hold (claims, rule 5): no pod of it would ever be bound.
"""

from collections.abc import Iterator, Mapping
from typing import Any

from robotapp_claims.rules.objects import ROS_DOMAIN_ID
from robotapp_operator.plan.spec.objects import pod_spec

_PLACES = ("initContainers", "containers")


def unowned_pointers(spec: Mapping[str, Any], wanted: Mapping[str, Any]) -> list[str]:
    """JSON pointers into a Deployment whose spec is `spec`: literal domains `wanted` does not name, last ones first.

    In this order they can be removed one after the other.
    """
    ours = {value for _, value in _literals(wanted)}
    return [pointer for pointer, value in _literals(spec) if value not in ours][::-1]


def domain_literals(spec: Mapping[str, Any]) -> frozenset[str]:
    """Returns the domains that the pod template of a Deployment's or Job's spec names."""
    return frozenset(value for _, value in _literals(spec))


def _literals(spec: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    pod = pod_spec(spec)
    for place in _PLACES:
        for index, container in enumerate(pod.get(place) or ()):
            for number, variable in enumerate(container.get("env") or ()):
                if variable.get("name") == ROS_DOMAIN_ID and variable.get("value"):
                    yield f"/spec/template/spec/{place}/{index}/env/{number}", variable["value"]
