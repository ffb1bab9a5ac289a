"""A robot that vanishes for a while loses nothing: which instances go on without a node, and until when."""

from typing import Any

import msgspec
import pytest
from tests.support.factories import app_body, domain_claim, make_app, make_deployment, make_node, robots

from robotapp_api.model.names import Label
from robotapp_claims.rules.objects import Holder, OwnerReference
from robotapp_operator.plan.render.instance_object import AppInstance, wanted_object
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.lister import problems_now, wanted_instances
from robotapp_operator.watch.out_of_sight import MANY_MISSING_S, OutOfSight

ALL = {"matchExpressions": [{"key": "robotics.io/robot", "operator": "Exists"}]}
NAMES = [f"r-{number:02}" for number in range(40)]


class RobotApps:
    """One app on robots, its grace being 300 s."""

    def __init__(self, *names: str, count: int = 0, **spec: Any) -> None:
        self.now_s = 0.0
        self.cache = Cache()
        self.names = names or tuple(NAMES[:count])
        self.app = make_app(robots={"nodeSelector": ALL, **spec})
        self.cache.update_app(app_body(robots={"nodeSelector": ALL}))
        self.restart()
        self.bring(*self.names)
        for name in self.names:
            self.deploy(self.app, name)
            self.show(self.app, name)

    def restart(self) -> None:
        """The caches of a new process are full before it works; what it remembers is gone."""
        self.cache.sight = OutOfSight(lambda: self.now_s)

    def bring(self, *names: str) -> None:
        self.cache.nodes.update(robots(*names))

    def take(self, *names: str) -> None:
        for name in names:
            del self.cache.nodes[f"n-{name}"]

    def deploy(self, app: App, robot: str, *, owned: bool = True) -> None:
        found = make_deployment(f"d-{robot}", uid=f"uid-{robot}")
        owner = OwnerReference(api_version="robotics.io/v1alpha1", kind="RobotApp", uid=app.uid, controller=True)
        labels = {Label.APP_UID.value: app.uid, Label.INSTANCE.value: robot}
        meta = msgspec.structs.replace(found.metadata, labels=labels, owner_references=(owner,) if owned else ())
        self.cache.deployments.put(app.uid, f"default/d-{robot}", msgspec.structs.replace(found, metadata=meta))

    def show(self, app: App, robot: str) -> None:
        """As the operator does for an instance that it has started."""
        shown = wanted_object(app, robot)
        shown["metadata"]["uid"] = f"shown-{app.uid}-{robot}"
        self.cache.put_instance_object(msgspec.convert(shown, AppInstance))

    def instances(self, *, after_s: float = 0.0) -> list[str]:
        self.now_s += after_s
        return [instance.robot for instance in wanted_instances(self.app, self.cache)]

    def missing(self) -> list[str]:
        return [instance.robot for instance in wanted_instances(self.app, self.cache) if instance.missing]


@pytest.mark.parametrize("how", ["node deleted", "robot label off", "label of the selector off"])
def test_an_instance_goes_on_for_the_grace_after_its_node_vanished_and_ends_then(how: str) -> None:
    world = RobotApps("a", "b", nodeSelector={"matchLabels": {Label.TIER.value: "robot"}})
    if how == "node deleted":
        world.take("a")
    else:
        world.cache.nodes["n-a"] = make_node(
            "n-a", **({"tier": "robot"} if how == "robot label off" else {"robot": "a"})
        )
    assert world.instances() == ["a", "b"]
    assert world.missing() == ["a"]
    assert world.instances(after_s=299) == ["a", "b"]
    assert world.instances(after_s=1) == ["b"]


def test_a_node_that_comes_back_in_time_begins_a_new_grace_the_next_time() -> None:
    world = RobotApps("a", "b")
    for _ in range(5):
        world.take("a")
        assert world.instances(after_s=200) == ["a", "b"]
        world.bring("a")
        assert world.instances(after_s=1) == ["a", "b"]
        assert world.missing() == []


def test_a_restart_of_the_operator_begins_the_grace_anew() -> None:
    world = RobotApps("a", "b")
    world.take("a")
    assert world.instances(after_s=299) == ["a", "b"]
    world.restart()
    assert world.instances(after_s=299) == ["a", "b"]
    assert world.instances(after_s=300) == ["b"]


@pytest.mark.parametrize(
    ("count", "lost", "braked"),
    [
        (40, 4, False),
        (40, 5, True),
        (10, 3, False),
        (10, 4, True),
        (2, 2, True),
        (1, 1, False),
        (3, 3, True),
        (4, 3, False),
    ],
)
def test_nothing_ends_while_too_many_robots_are_missing_however_often_the_operator_restarts(
    count: int, lost: int, braked: bool
) -> None:
    world = RobotApps(count=count)
    world.take(*NAMES[:lost])
    world.instances()
    for _ in range(3):
        world.instances(after_s=301)
        assert len(world.instances()) == (count if braked else count - lost)
        world.restart()
        world.instances()
    if braked:
        assert world.cache.sight.look_again_s(world.app) is not None
        world.instances(after_s=301)
        assert world.cache.sight.look_again_s(world.app) == MANY_MISSING_S


def test_the_brake_counts_robots_that_hold_claims_alone() -> None:
    world = RobotApps("a", "b", "c", "d", "e")
    for name in ("v", "w", "x"):  # their instances have ended already, with their claims parked
        claim = _claim_of(name)
        world.cache.claims.put("other", claim.name, claim)
    world.take("a")
    world.instances()
    assert world.instances(after_s=1000) == ["a", "b", "c", "d", "e"], "4 of 8 are missing"


def _claim_of(robot: str) -> Any:
    found = domain_claim(ord(robot))
    holder = Holder(
        api_version="robotics.io/v1alpha1",
        kind="RobotApp",
        namespace="default",
        name="other",
        uid="other",
        instance=robot,
    )
    return msgspec.structs.replace(found, spec=msgspec.structs.replace(found.spec, holder=holder))


def test_a_change_of_the_selector_ends_instances_at_once_also_of_robots_out_of_sight() -> None:
    world = RobotApps("a", "b", "c")
    world.take("a")
    assert world.instances() == ["a", "b", "c"]
    only_c = {"matchLabels": {Label.ROBOT.value: "c"}}
    world.app = make_app(robots={"nodeSelector": only_c}, generation=2)
    assert world.instances() == ["c"]
    assert world.instances(after_s=1) == ["c"], "and it stays so until their Deployments are gone"


def test_another_edit_of_the_app_ends_nothing() -> None:
    world = RobotApps("a", "b")
    world.take("a")
    world.instances()
    world.app = make_app(robots={"nodeSelector": ALL}, suspend=True, generation=2)
    assert world.instances() == ["a", "b"]


def test_a_robot_that_revokes_its_admission_loses_the_instance_at_once() -> None:
    world = RobotApps("a", "b")
    world.cache.nodes["n-a"] = make_node("n-a", robot="a", annotations={"robotics.io/allowed-namespaces": "other"})
    assert world.instances() == ["b"]


def test_any_stays_with_its_robot_while_that_is_out_of_sight() -> None:
    world = RobotApps("a", assignment="Any")
    world.bring("b", "c")
    assert world.instances() == ["a"]
    world.take("a")
    assert world.instances() == ["a"]
    assert world.instances(after_s=299) == ["a"]
    assert world.instances(after_s=1) != ["a"]


def test_a_deployment_that_only_wears_labels_makes_no_instance() -> None:
    world = RobotApps("a")
    world.deploy(world.app, "ghost", owned=False)
    assert world.instances() == ["a"]


def only(*names: str, **labels: str) -> dict[str, Any]:
    expressions = [{"key": Label.ROBOT.value, "operator": "In", "values": list(names)}]
    return {"nodeSelector": {"matchExpressions": expressions, "matchLabels": labels}}


@pytest.mark.parametrize(
    ("robots", "kept"),
    [
        (only("a", "b", "c", "d"), True),
        (only("a", "c"), True),
        (only("a", "b"), False),
        (only("a", "c", hall="2"), False),
        (only("a", "c") | {"assignment": "Any"}, False),
    ],
)
def test_an_edit_of_the_selector_ends_no_instance_of_a_robot_out_of_sight_that_it_still_selects(
    robots: dict[str, Any], kept: bool
) -> None:
    world = RobotApps("a", "b", "c")
    world.app = make_app(robots=only("a", "b", "c"), generation=2)
    assert world.instances() == ["a", "b", "c"]
    world.take("c")
    assert world.missing() == ["c"]
    world.app = make_app(robots=robots, generation=3)
    assert ("c" in world.instances()) is kept


def test_deployments_for_robots_that_never_were_make_no_instances_and_hold_up_no_end() -> None:
    world = RobotApps("a", "b", "c")
    for number in range(9):
        world.deploy(world.app, f"ghost-{number}")
    assert world.instances() == ["a", "b", "c"]
    world.take("c")
    assert world.instances() == ["a", "b", "c"]
    assert world.instances(after_s=300) == ["a", "b"]


def test_an_app_all_of_whose_robots_are_out_of_sight_is_still_accepted_so_that_it_follows_its_user() -> None:
    world = RobotApps("a", "b")
    world.take("a", "b")
    assert problems_now(world.app, world.cache) == ()
    world.app = make_app(robots={"nodeSelector": {"matchLabels": {Label.ROBOT.value: "z"}}}, generation=2)
    assert [problem.field for problem in problems_now(world.app, world.cache)] == ["spec.robots.nodeSelector"]


def test_the_end_of_a_grace_is_an_appointment_and_nothing_missing_is_none() -> None:
    world = RobotApps("a", "b")
    world.instances()
    assert world.cache.sight.look_again_s(world.app) is None
    world.take("a")
    world.instances()
    world.now_s += 100
    assert world.cache.sight.look_again_s(world.app) == 200
    world.cache.forget_app(world.app.uid)
    assert world.cache.sight.look_again_s(world.app) is None
