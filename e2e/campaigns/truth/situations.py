"""What can become of an app: each situation is an app, what happens around it, and what must be on the screen in the end."""

from collections.abc import Mapping

from campaigns.truth.arranging import (
    BUS,
    NO_GRACE,
    NOWHERE,
    ON_BOARD,
    WELL,
    Situation,
    all_robots,
    broken,
    cordoned,
    edge,
    edited,
    labelled,
    other_app,
    pool_of,
    robot,
    rtt,
    running,
    with_domain,
    wrong,
)
from campaigns.truth.over_time import OVER_TIME
from robotapp_api.model.names import Label

SITUATIONS: Mapping[str, Situation] = {
    "a plain app": running(),
    "one component": running(parts=({"name": "only"},)),
    "two replicas": running(parts=({"name": "talk", "replicas": 2}, {"name": "hear"})),
    "a ROS 1 app": running(spec=lambda _: {"ros": {"distro": "noetic"}}),
    "suspended from the start": Situation(
        says={"Ready": "False/Suspended", "Placed": "Unknown/Suspended"},
        phase="Suspended",
        spec=lambda _: {"suspend": True},
    ),
    "suspended while it runs": Situation(
        says={"Ready": "False/Suspended"}, phase="Suspended", then=lambda place: edited(place, suspend=True)
    ),
    "an unknown distribution": wrong("UnknownDistro", spec=lambda _: {"ros": {"distro": "humbel"}}),
    "an unknown distribution with a budget": wrong(
        "UnknownDistro", spec=lambda _: {"ros": {"distro": "humbel"}, "edges": edge("30ms")}
    ),
    "another ROS version than the distribution's": wrong(spec=lambda _: {"ros": {"distro": "humble", "version": 1}}),
    "a variable the operator sets": wrong(
        parts=({"name": "talk", "env": [{"name": "RMW_IMPLEMENTATION", "value": "x"}]}, {"name": "hear"})
    ),
    "no robot matches": wrong(
        "NoMatchingRobot",
        "Pending",
        spec=lambda _: {"robots": {"nodeSelector": {"matchLabels": {Label.ROBOT.value: "nobody"}}}},
    ),
    "a master node that is not there": wrong(
        "InvalidSpec", "Pending", spec=lambda _: {"placement": {"masterNode": "ghost"}}
    ),
    "valid, then invalid": wrong(then=lambda place: edited(place, ros={"distro": "humble", "version": 1})),
    "three robots": running(spec=lambda place: {"robots": all_robots(place)}),
    "one robot": running(spec=lambda place: {"robots": robot(place)}, parts=ON_BOARD),
    "on an edge server": running(parts=({"name": "talk", "runsOn": ["Edge"]}, {"name": "hear"})),
    "in the cloud, else on an edge server": running(parts=({"name": "talk", "runsOn": ["Cloud", "Edge"]},)),
    "an edge server is wanted, all are cordoned, so on board": running(
        says=WELL | {"Placed": "True/FallbackUsed"},
        parts=({"name": "talk", "runsOn": ["Edge", "Robot"]},),
        spec=lambda place: {"robots": robot(place)},
        around=lambda place: cordoned(place, *place.edges),
    ),
    "only on edge servers, all are cordoned": Situation(
        says=NOWHERE,
        phase="Placing",
        parts=({"name": "talk", "runsOn": ["Edge"]},),
        around=lambda place: cordoned(place, *place.edges),
    ),
    "a budget that is met": running(
        says=WELL | {"BudgetMet": "True/WithinBudget"},
        parts=ON_BOARD,
        spec=lambda place: {"robots": robot(place), "edges": edge("90ms")},
    ),
    "a budget of the median": running(
        says=WELL | {"BudgetMet": "True/WithinBudget"},
        parts=ON_BOARD,
        spec=lambda place: {"robots": robot(place), "edges": edge("90ms", percentile=50)},
    ),
    "an edge without a budget": running(says=WELL | {"BudgetMet": "True/NoBudget"}, spec=lambda _: {"edges": edge()}),
    "a budget no place can meet": Situation(
        says=NOWHERE,
        phase="Placing",
        parts=({"name": "talk", "runsOn": ["Cloud"]}, {"name": "hear", "runsOn": ["Robot"]}),
        spec=lambda place: {"robots": robot(place), "edges": edge("5ms")},
    ),
    "a preferred budget that no place meets, given up after a second": running(
        says=WELL | {"Placed": "True/FallbackUsed", "BudgetMet": "False/BudgetExceeded"},
        parts=ON_BOARD,
        spec=lambda place: {
            "robots": robot(place),
            "edges": edge("1ms", enforce="Preferred"),
            "placement": {"fallback": {"after": "1s"}},
        },
    ),
    "a link that became too slow": running(
        says=WELL | {"BudgetMet": "False/BudgetExceeded"},
        parts=ON_BOARD,
        spec=lambda place: {"robots": robot(place), "edges": edge("40ms")},
        around=lambda place: cordoned(place, place.edges[1]),
        then=lambda place: rtt(place, place.edges[0], place.robots[0], 80.0),
    ),
    "a device": running(parts=({"name": "talk", **BUS},)),
    "a device somebody else holds": Situation(
        says={"Allocated": "False/DeviceBusy", "Placed": "False/Unschedulable"},
        phase="Placing",
        parts=({"name": "talk", **BUS},),
        around=lambda place: other_app(place, parts=({"name": "x", **BUS},)),
    ),
    "a device no node has": Situation(
        says=NOWHERE | {"Allocated": "False/WaitingForDevices"},
        phase="Placing",
        parts=({"name": "talk", "devices": [{"name": "eye", "type": "usb", "model": "nobody-makes-it"}]},),
    ),
    "a device that is shared": running(
        parts=({"name": "talk", "devices": [{"name": "bus", "type": "can", "sharing": "Cluster"}]},)
    ),
    "more processors than any node has": Situation(
        says=NOWHERE, phase="Placing", parts=({"name": "talk", "resources": {"requests": {"cpu": "5000"}}},)
    ),
    "a node selector nothing fits": Situation(
        says=NOWHERE,
        phase="Placing",
        parts=({"name": "talk", "template": {"spec": {"nodeSelector": {"nobody": "has"}}}},),
    ),
    "parameters in the app": running(
        parts=(
            {"name": "talk", "args": ["run"], "parameters": [{"inline": "talk:\n  ros__parameters:\n    speed: 1\n"}]},
        )
    ),
    "a domain of its own choice": running(spec=lambda _: {"ros2": {"domain": 17}}),
    "a domain another app has": Situation(
        says=with_domain("DomainTaken"),
        phase="Pending",
        spec=lambda _: {"ros2": {"domain": 18}},
        around=lambda place: other_app(place, ros2={"domain": 18}),
    ),
    "a pool that is not there": Situation(
        says=with_domain("PoolNotFound"), phase="Pending", spec=lambda _: {"ros2": {"pool": "nowhere"}}
    ),
    "a pool that is full": Situation(
        says=with_domain("DomainExhausted"),
        phase="Pending",
        spec=lambda place: {"ros2": {"pool": place.pool("one")}},
        around=lambda place: other_app(place, ros2={"pool": place.pool("one")}),
    ),
    "a pool with a quota of nothing": Situation(
        says=with_domain("QuotaExceeded"),
        phase="Pending",
        spec=lambda place: {"ros2": {"pool": place.pool("quota")}},
        around=lambda place: pool_of(place, "quota", ids="60-69", quota={"default": 0}),
    ),
    "a domain shared with another app": running(
        spec=lambda place: {"ros2": {"shareWith": [{"namespace": place.site.namespace, "name": "other"}]}},
        around=other_app,
    ),
    "a domain of an app that is not there": Situation(
        says={"Ready": "False/*", "Allocated": "*/*"},
        phase="Pending",
        spec=lambda place: {"ros2": {"shareWith": [{"namespace": place.site.namespace, "name": "nobody"}]}},
    ),
    "together on one node": running(parts=({"name": "talk", "colocateWith": ["hear"]}, {"name": "hear"})),
    "never on one node": running(parts=({"name": "talk", "separateFrom": ["hear"]}, {"name": "hear"})),
    "fields that do nothing yet": running(spec=lambda _: {"ros2": {"transport": "SHM"}}),
    "a robot out of reach": Situation(
        says={"Ready": "False/RobotOffline"},
        phase="Offline",
        parts=ON_BOARD,
        spec=lambda place: {"robots": robot(place), "connectivity": NO_GRACE},
        then=lambda place: broken(place, place.robots[0]),
    ),
    "a robot out of reach for a moment": Situation(
        says={"Ready": "False/RobotNotReady"},
        phase="Degraded",
        parts=ON_BOARD,
        spec=lambda place: {"robots": robot(place)},
        then=lambda place: broken(place, place.robots[0]),
    ),
    "one of three robots out of reach": Situation(
        says={"Ready": "False/RobotOffline"},
        phase="Degraded",
        parts=ON_BOARD,
        spec=lambda place: {"robots": all_robots(place), "connectivity": NO_GRACE},
        then=lambda place: broken(place, place.robots[0]),
    ),
    "a robot with two computers and none of them primary": Situation(
        says={"Accepted": "True/Accepted", "Ready": "False/RobotNodeUnclear"},
        phase="Pending",
        spec=lambda place: {"robots": robot(place)},
        around=lambda place: labelled(place, place.edges[1], robot=place.robots[0]),
    ),
    "an update that fits nowhere": Situation(
        says={"Ready": "False/*", "Placed": "False/Unschedulable"},
        phase="Placing",
        then=lambda place: edited(
            place, components=[{"name": "talk", "image": "y", "resources": {"requests": {"cpu": "5000"}}}]
        ),
    ),
    **OVER_TIME,
}
