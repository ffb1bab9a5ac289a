"""Whether an observed object has all that the operator renders, decided without a request, which would cost a write per look.

An observed object carries defaults and canonical quantities that the API server added, so "equal" means: every rendered field
has an equal value in the observed object, and the content hash that was written with it is that of today's rendering
(else a field that is no longer rendered would stay).
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from typing import Any, Final

from robotapp_api.values.quantities.quantity import parse_milli

_DROPPED_WHEN_OFF: Final = frozenset({"readOnly", "stdin", "stdinOnce", "tty", "hostPort"})
"""Fields of core whose false or 0 is not stored; of other flags false differs from absence, as of automountServiceAccountToken."""


def content_hash(content: Any) -> str:
    """16 hex digits over the canonical JSON of `content`."""
    canonical = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(canonical.encode()).hexdigest()[:16]


def covers(observed: Any, wanted: Any) -> bool:
    """Whether `observed` has every value of `wanted`. Lists must have the same length and order."""
    if isinstance(wanted, Mapping):
        if not isinstance(observed, Mapping):
            return not wanted
        return all(_covers_field(observed, key, value) for key, value in wanted.items())
    if isinstance(wanted, Sequence) and not isinstance(wanted, str):
        if not isinstance(observed, Sequence) or isinstance(observed, str):
            return not wanted and observed is None
        return len(observed) == len(wanted) and all(map(covers, observed, wanted))
    return bool(observed == wanted) or _same_quantity(observed, wanted)


def _covers_field(observed: Mapping[str, Any], key: str, value: Any) -> bool:
    # The server drops empty maps, empty lists and "" of optional fields.
    is_dropped = value in ({}, [], "", None) or (not value and key in _DROPPED_WHEN_OFF)
    return (key not in observed and is_dropped) or covers(observed.get(key), value)


def _same_quantity(observed: Any, wanted: Any) -> bool:
    """`1000m` is stored as `1`."""
    if not isinstance(observed, str | int) or not isinstance(wanted, str | int | float):
        return False
    if isinstance(observed, bool) or isinstance(wanted, bool):
        return False
    try:
        return parse_milli(observed) == parse_milli(str(wanted))
    except ValueError:
        return False
