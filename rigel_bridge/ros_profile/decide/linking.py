"""Types of C++ endpoints that another file of the package gives: aliases, callbacks and members declared in headers."""

from collections.abc import Iterable
from dataclasses import replace

from ros_profile.model.endpoints import Endpoint, Role
from ros_profile.model.facts import Fact, Kind
from ros_profile.read.cpp.types import resolved, ros_name

_KIND = {
    Role.SERVICE_SERVER: "srv",
    Role.SERVICE_CLIENT: "srv",
    Role.ACTION_SERVER: "action",
    Role.ACTION_CLIENT: "action",
}


def linked(endpoints: Iterable[Endpoint], facts: Iterable[Fact]) -> tuple[Endpoint, ...]:
    """The same endpoints with types in the form `package/msg/Name` where any file gives them, else empty."""
    names = {fact.subject: fact.value for fact in facts if fact.kind is Kind.ALIAS}
    return tuple(_linked(endpoint, names) for endpoint in endpoints)


def _linked(endpoint: Endpoint, names: dict[str, str]) -> Endpoint:
    if "/" in endpoint.type or not endpoint.type:
        return endpoint
    written = names.get(endpoint.type, "") if endpoint.type[0] in "&." else endpoint.type
    found = ros_name(resolved(written, names), kind=_KIND.get(endpoint.role, "msg"))
    return replace(endpoint, type=found if "/" in found or "::" in found else "")
