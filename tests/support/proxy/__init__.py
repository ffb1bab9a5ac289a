"""A proxy that stands between our components and the real API server and misbehaves on demand.

    with FaultProxy(seed=7) as proxy:
        route = proxy.route("operator", control_plane.kubeconfig("operator"))
        start_operator(kubeconfig=route.kubeconfig)                       # or ApiClient(route.endpoint, ...)

        proxy.add(lose_reply(), component="operator", verbs="create", resource="robotclaims")     # the first one, once
        proxy.add(answer(429, "TooManyRequests", retry_after_s=1), verbs="write", times=3)
        proxy.add(answer(504, "Timeout", applied=True), verbs="patch", skip=2)                    # the third patch
        proxy.add(drop(), verbs="write", probability=0.05, times=None)                            # seeded chance
        proxy.add(gone_event(after=10), verbs="watch", resource="pods")
        proxy.cut_watches(resource="pods")
        with proxy.hold_watches(component="operator"): ...                                        # stale caches
        with proxy.partition("operator"): ...                                                     # cut off altogether

        for index in range(1, 120):                                                               # crash campaign
            proxy.kill_at("operator", index, Moment.AFTER, operator.kill)
        proxy.ledger.writes(component="operator", resource="robotclaims", applied=True)

It runs in a thread of its own and its methods may be called from any thread, so the same lines serve synchronous and
asyncio tests. Towards components it speaks plain HTTP on loopback, one port per component; towards the server it uses
the identity of the kubeconfig given to `route`. Events and leases appear in the ledger but are not counted.
"""

from tests.support.proxy.calls import Call
from tests.support.proxy.faults import (
    Fault,
    Rule,
    answer,
    delay,
    drop,
    end_watch,
    error_event,
    garble,
    garble_line,
    gone_event,
    hide,
    lose_reply,
    reset,
    stall,
    truncate,
)
from tests.support.proxy.ledger import Ledger, Moment, Write
from tests.support.proxy.server import FaultProxy, Route

__all__ = [
    "Call",
    "Fault",
    "FaultProxy",
    "Ledger",
    "Moment",
    "Route",
    "Rule",
    "Write",
    "answer",
    "delay",
    "drop",
    "end_watch",
    "error_event",
    "garble",
    "garble_line",
    "gone_event",
    "hide",
    "lose_reply",
    "reset",
    "stall",
    "truncate",
]
