"""What operator and scheduler write while nothing changes, and what they are refused, from the audit log."""

import time
from bisect import bisect_left
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from typing import Any, Final

from robotapp_operator.plan.status import pace
from robotapp_operator.reconcile import controller
from robotapp_operator.watch import informers
from robotapp_testbed import ControlPlane, wait_until
from robotapp_testbed.control_plane import audit
from robotapp_testbed.control_plane.identity import OPERATOR_ACCOUNT, SCHEDULER_ACCOUNT

REST_S: Final = (
    max(controller.FLEET_REST_S, controller.POOL_REST_S, controller.PROBES_REST_S, *pace.PROGRESS_REST_S)
    + max(informers.FLEET_DELAY_S, informers.POOL_DELAY_S, informers.LATENCY_DELAY_S)
    + 1.0
)
"""A second longer than the operator puts off any write but that of latency figures, which move only with telemetry."""
_OURS = (OPERATOR_ACCOUNT, SCHEDULER_ACCOUNT)
_BY_THE_CLOCK = frozenset({"leases"})
_LOG_DELAY_S = 0.5
"""The server flushes audit records in batches of this order."""
_LOOK_OVERLAP: Final = timedelta(seconds=5)
"""A record may come this much later than the request has ended."""


def writes_since(cp: ControlPlane, since: datetime, *, namespace: str = "") -> list[Mapping[str, Any]]:
    """Successful writes by our two accounts, Leases left out, that the server received after `since`; to objects of one
    namespace if it is given."""
    return [
        record for record in _our_writes(cp.audit(since=since), namespace=namespace) if _received_at(record) >= since
    ]


def requests_since(cp: ControlPlane, since: datetime, *, account: str) -> Counter[str]:
    """How often an account asked for what after `since`, reads included: `verb resource/subresource`."""
    return Counter(
        " ".join(_shown(record).split()[1:3])
        for record in cp.audit(since=since)
        if record["user"].get("username", "").rpartition(":")[2] == account
        and record.get("objectRef", {}).get("resource") not in (None, *_BY_THE_CLOCK)
        and _received_at(record) >= since
    )


def most_within_a_minute(times: Sequence[datetime]) -> int:
    """The most of these, which are in order, that lie within one minute; a second less, for what requests take."""
    minute = timedelta(seconds=59)
    return max((bisect_left(times, one + minute) - index for index, one in enumerate(times)), default=0)


def refused_since(cp: ControlPlane, since: datetime) -> set[str]:
    """Requests of our two accounts after `since` that they have no right to: who, verb, path.

    A 403 for another reason (a namespace that is being deleted, a quota) is not among them.
    """
    return {
        f"{record['user'].get('username', '').rpartition(':')[2]} {record['verb']} {record['requestURI'].partition('?')[0]}"
        for record in cp.audit(since=since)
        if record["user"].get("username", "").rpartition(":")[2] in _OURS
        and record.get("annotations", {}).get("authorization.k8s.io/decision") == "forbid"
        and _received_at(record) >= since
    }


def until_quiet(cp: ControlPlane, *, quiet_s: float, within_s: float, namespace: str = "") -> bool:
    """Waits until neither wrote anything (there) for `quiet_s`; False when that did not come.

    Each look reads what was recorded since the last one, not the whole of the time that has to be quiet.
    """
    silence = timedelta(seconds=quiet_s)
    last_look = last_write = datetime.now(UTC) - silence

    def is_quiet() -> bool:
        nonlocal last_look, last_write
        now = datetime.now(UTC)
        records = _our_writes(cp.audit(since=last_look - _LOOK_OVERLAP), namespace=namespace)
        last_write = max((last_write, *map(_received_at, records)))
        last_look = now
        return now - last_write >= silence

    return wait_until(is_quiet, timeout_s=within_s, poll_s=0.5)


def writes_during(cp: ControlPlane, seconds: float, *, namespace: str = "") -> list[Mapping[str, Any]]:
    """Let time pass, then return what was written meanwhile (there)."""
    began = datetime.now(UTC)
    time.sleep(seconds + _LOG_DELAY_S)
    return [
        record
        for record in writes_since(cp, began, namespace=namespace)
        if _received_at(record) <= began + timedelta(seconds=seconds)
    ]


def by_object(records: Iterable[Mapping[str, Any]]) -> Counter[str]:
    """How often each object was written: `user verb resource/subresource namespace/name`."""
    return Counter(_shown(record) for record in records)


def _our_writes(records: Iterable[dict[str, Any]], *, namespace: str) -> list[dict[str, Any]]:
    """Returns the successful writes by our two accounts, Leases left out; to objects of one namespace if it is given."""
    return [
        record
        for record in audit.writes(records)
        if record["user"].get("username", "").rpartition(":")[2] in _OURS
        and record["objectRef"]["resource"] not in _BY_THE_CLOCK
        and namespace in ("", record["objectRef"].get("namespace"))
    ]


def _received_at(record: Mapping[str, Any]) -> datetime:
    return datetime.fromisoformat(record["requestReceivedTimestamp"])


def _shown(record: Mapping[str, Any]) -> str:
    ref = record["objectRef"]
    kind = "/".join(part for part in (ref["resource"], ref.get("subresource", "")) if part)
    user = record["user"].get("username", "").rpartition(":")[2]
    return f"{user} {record['verb']} {kind} {ref.get('namespace', '')}/{ref.get('name', '')}"
