"""Apps the API server takes although they cannot work: a condition must name the field and say what to write instead."""

from dataclasses import dataclass
from typing import Any

from campaigns.rigs.world import plain_app
from robotapp_api.model.names import Condition

Object = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Misfit:
    """`kind` turns False with a message that contains `field` and every one of `words`."""

    app: Object
    field: str
    words: tuple[str, ...]
    kind: Condition = Condition.ACCEPTED


def misfits() -> list[Misfit]:
    edge = {"topic": "/odom", "from": "sense", "to": "act"}
    nowhere = {"matchLabels": {"robotics.io/robot": "nobody"}}
    return [
        Misfit(plain_app("misspelt", ros={"distro": "humbel"}), "spec.ros.distro", ("humbel", "humble")),
        Misfit(plain_app("ros2-in-ros1", ros={"distro": "noetic"}, ros2={}), "spec.ros2", ("noetic",)),
        Misfit(plain_app("ros1-in-ros2", ros={"distro": "jazzy"}, ros1={}), "spec.ros1", ("jazzy",)),
        Misfit(_torn(), "spec.components[2].separateFrom", ("act", "sense", "colocateWith", "remove")),
        Misfit(plain_app("robotless", robots={"nodeSelector": nowhere}), "spec.robots.nodeSelector", ("no robot matches", "robots that admit namespace")),
        Misfit(plain_app("masterless", placement={"masterNode": "atlantis"}), "spec.placement.masterNode", ("atlantis", "kubectl get nodes")),
        Misfit(
            plain_app("isolated", ros2={"discovery": {"mode": "Localhost"}}, edges=[edge]),
            "spec.ros2.discovery.mode",
            ("Localhost", "Auto"),
        ),
        Misfit(_with_file("file-ros1", ros={"distro": "noetic"}), "spec.components[0].parameters", ("rosparam",)),
        Misfit(_with_file("file-bare"), "spec.components[0].parameters", ("command or args",)),
        Misfit(
            plain_app("poolless", ros2={"pool": "atlantis"}),
            "spec.ros2.pool",
            ("atlantis", "kubectl get domainpools"),
            Condition.ALLOCATED,
        ),
    ]  # fmt: skip


def _torn() -> Object:
    """Sense with plan, plan with act, yet act apart from sense: only the chain shows it."""
    app = plain_app("torn")
    sense, plan, act = app["spec"]["components"]
    sense["colocateWith"], plan["colocateWith"], act["separateFrom"] = ["plan"], ["act"], ["sense"]
    return app


def _with_file(name: str, **spec: Any) -> Object:
    app = plain_app(name, **spec)
    app["spec"]["components"][0]["parameters"] = [{"configMapKeyRef": {"name": "drv", "key": "params.yaml"}}]
    return app
