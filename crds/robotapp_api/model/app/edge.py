"""Edges: who talks to whom, how often, with which QoS and within which time. The heart of placement."""

from typing import Annotated, Final, Literal

from pydantic import Field, WithJsonSchema

from robotapp_api.model.base import Model
from robotapp_api.model.markers import Rule
from robotapp_api.model.scalars import Duration, EdgeEnd, InterfaceType, Quantity, TopicName, is_duration

Reliability = Literal["reliable", "best_effort"]
Durability = Literal["volatile", "transient_local"]
Liveliness = Literal["automatic", "manual_by_topic"]
Percentile = Literal[50, 95]
Enforce = Literal["Required", "Preferred"]
EdgeKind = Literal["Topic", "Service", "Action"]
QOS_STRENGTHS: Final = {
    "reliability": ("best_effort", "reliable"),
    "durability": ("volatile", "transient_local"),
    "liveliness": ("automatic", "manual_by_topic"),
}
"""Weaker and stronger value of a policy: DDS refuses a pair that offers the weaker where the stronger is asked."""
QOS_DURATIONS: Final = ("deadline", "lease")
"""DDS refuses a pair that offers a longer one than is asked."""


class Qos(Model):
    """DDS quality of service; what is absent is not compared."""

    reliability: Reliability | None = None
    """reliable re-sends lost messages, best_effort does not."""
    durability: Durability | None = None
    """transient_local keeps messages for late joiners, volatile does not."""
    history: Literal["keep_last", "keep_all"] | None = None
    """keep_last holds `depth` messages, keep_all holds every message until it is read."""
    depth: Annotated[int, Field(ge=0, le=100_000)] | None = None
    """Messages held with keep_last."""
    deadline: Duration | None = None
    """Longest time between two messages."""
    liveliness: Liveliness | None = None
    """Who says that a publisher is alive: the middleware (automatic) or the application for each topic."""
    lease: Duration | None = None
    """Time after which a silent publisher counts as dead."""


class EdgeLatency(Model):
    """Ceiling of the round-trip time between the two ends of an edge."""

    budget: Annotated[
        Duration,
        Rule(
            rule=f"!{is_duration('self')} || duration(self) > duration('0s')",
            message="budget must be above zero; write for example 30ms",
        ),
    ]
    """Round-trip time the nodes of the two ends may have between them, such as 30ms."""
    percentile: Percentile = 95
    """Percentile of the measured round-trip time that is compared, 50 or 95."""
    enforce: Enforce = "Required"
    """Required refuses nodes outside the budget, Preferred only ranks them lower; placement.fallback holds it for some time."""


def _qos_refusal(field: str, *, when: str, offered: str, asked: str) -> Rule:
    """A pair of QoS values that DDS itself refuses, once both sides have stated `field`."""
    both = f"has(self.qos) && has(self.requestedQos) && has(self.qos.{field}) && has(self.requestedQos.{field})"
    return Rule(
        rule=f"!({both}) || !({when})",
        message=f"{field}: `from` offers less than `to` asks, so DDS refuses the pair; write {offered} or {asked}",
        expression=f"'edge %s: {field} %s is offered but %s is asked, so DDS refuses the pair; write {offered} or {asked}'"
        f".format([self.topic, self.qos.{field}, self.requestedQos.{field}])",
        path=f".requestedQos.{field}",
    )


def _weaker_offer(field: str, *, weaker: str, stronger: str) -> Rule:
    return _qos_refusal(
        field,
        when=f"self.requestedQos.{field} == '{stronger}' && self.qos.{field} == '{weaker}'",
        offered=f"qos.{field}: {stronger}",
        asked=f"requestedQos.{field}: {weaker}",
    )


def _longer_offer(field: str) -> Rule:
    asked, offered = f"self.requestedQos.{field}", f"self.qos.{field}"
    shorter = f"{is_duration(asked)} && {is_duration(offered)} && duration({asked}) < duration({offered})"
    return _qos_refusal(field, when=shorter, offered=f"a shorter qos.{field}", asked=f"a longer requestedQos.{field}")


class Edge(Model):
    """A topic, service or action between two components, or between a component and the robot itself."""

    RULES = (
        Rule(
            rule="self.from != self.to",
            message="an edge needs two different ends; write another component in from or to, or drop the edge",
            expression="'edge %s: from and to are both %s; write another component in one of them, or drop the edge'.format([self.topic, self.from])",
        ),
        *(
            _weaker_offer(field, weaker=weaker, stronger=stronger)
            for field, (weaker, stronger) in QOS_STRENGTHS.items()
        ),
        *(_longer_offer(field) for field in QOS_DURATIONS),
    )

    kind: EdgeKind = "Topic"
    """What `topic` names: a Topic, a Service or an Action."""
    topic: TopicName
    """Topic, service or action name, such as /cmd_vel."""
    type: InterfaceType | None = None
    """ROS interface type, such as geometry_msgs/msg/Twist."""
    from_: Annotated[EdgeEnd, Field(alias="from")]
    """Component that publishes, or calls the service or action, or @robot for the robot's node itself."""
    to: EdgeEnd
    """Component that subscribes, or serves, or @robot for the robot's node itself."""
    rate_hz: Quantity | None = None
    """Messages per second, such as 20 or "0.5". Together with messageBytes it gives the bandwidth where that is not written."""
    message_bytes: (
        Annotated[
            int,
            Field(ge=0, le=2_147_483_648),
            WithJsonSchema({"type": "integer", "format": "int64", "minimum": 0, "maximum": 2_147_483_648}),
        ]
        | None
    ) = None
    """Typical size of a message in bytes. Together with rateHz it gives the bandwidth where that is not written."""
    qos: Qos | None = None
    """Quality of service offered by `from`."""
    requested_qos: Qos | None = None
    """Quality of service asked by `to`; where `qos` is written as well, pairs that DDS would refuse are refused here."""
    latency: EdgeLatency | None = None
    """Latency budget of the edge."""
    bandwidth: Quantity | None = None
    """Bits per second, such as 40M; absent means rateHz messages of messageBytes. All edges that leave a node must fit its access link,
    where the node annotation robotics.io/link-bandwidth states what that carries. Not a limit at run time."""
