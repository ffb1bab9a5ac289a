"""One watched resource and where its objects go."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from robotapp_api.client.api.resources import Resource
from robotapp_scheduler.core.events.cluster_event import Change


@dataclass(frozen=True, slots=True)
class Route:
    """How the objects of a resource are decoded, and who takes them; the answer is what changed for pods."""

    resource: Resource
    as_type: type[Any]
    apply: Callable[[Any], Change]
    remove: Callable[[Any], Change]
    label_selector: str = ""
    field_selector: str = ""
    fixed_keys: bool = False
    known_specs: bool = False
    """See `WatchDecoder`, for both."""
