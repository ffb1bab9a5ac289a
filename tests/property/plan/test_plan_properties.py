"""Laws of the plan, whatever the app and whatever is there already."""

import dataclasses
from typing import Any

import msgspec
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support.factories import VERSION, after, component, make_app

from robotapp_operator.plan.diff.diff import Observed, Plan, plan, ref_of, wanted_children
from robotapp_operator.plan.render.child import Child
from robotapp_operator.plan.render.parameters import ParameterState
from robotapp_operator.plan.spec.desired import App, Domain, desired_of
from robotapp_operator.plan.spec.objects import ChildRef, Deployment, Service

NAMES = st.sampled_from(
    ["driver", "operator", "mapper", "logger", "a-very-long-component-name-that-must-be-cut-somewhere"]
)
SMALL_TEXT = st.text(alphabet="abc-._/ $", max_size=8)
COMPONENTS = st.lists(
    st.builds(
        component,
        NAMES,
        image=st.sampled_from(["r/a:1", "r/b:2"]),
        runsOn=st.lists(st.sampled_from(["Robot", "Edge", "Cloud"]), unique=True),
        replicas=st.integers(0, 3),
        ros=st.sampled_from([None, None, "None"]),
        args=st.lists(SMALL_TEXT, max_size=2),
        env=st.lists(
            st.builds(lambda name, value: {"name": name, "value": value}, st.sampled_from(["A", "B"]), SMALL_TEXT),
            max_size=1,
        ),
        resources=st.sampled_from([{}, {"requests": {"cpu": "500m"}}, {"limits": {"memory": "1Gi"}}]),
        template=st.builds(
            lambda labels: {"spec": {"nodeSelector": labels}},
            st.dictionaries(st.sampled_from(["x", "y"]), st.sampled_from(["1", "2"]), max_size=2),
        ),
        parameters=st.sampled_from(
            [[], [{"configMapKeyRef": {"name": "c", "key": "k"}}, {"inline": "/**: {ros__parameters: {a: 1}}"}]]
        ),
    ),
    min_size=1,
    max_size=4,
    unique_by=lambda item: item["name"],
)
ROS = st.sampled_from(
    [
        {},
        {"ros": {"distro": "jazzy"}},
        {"ros2": {"rmw": "rmw_cyclonedds_cpp"}},
        {"ros2": {"rmw": "rmw_zenoh_cpp"}},
        {"ros2": {"discovery": {"mode": "Multicast"}}},
        {"ros": {"distro": "noetic"}},
        {"ros": {"distro": "none"}},
    ]
)


@st.composite
def apps(draw: st.DrawFn) -> App:
    extra: dict[str, Any] = draw(ROS)
    return make_app(
        *draw(COMPONENTS),
        name=draw(st.sampled_from(["teleop", "3d-map", "a" * 40])),
        suspend=draw(st.booleans()),
        schedulerName=draw(st.sampled_from(["ros-aware-scheduler", "default-scheduler"])),
        **extra,
    )


@st.composite
def children(draw: st.DrawFn, app: App) -> list[Child]:
    robot = draw(st.sampled_from(["", "amr-07"]))
    number = draw(st.integers(1, 101))
    domain = Domain(number, f"dds.default.c.{number}") if app.ros_version == 2 else None
    return wanted_children(
        desired_of(app, robot),
        domain=domain,
        parameters={"driver": ParameterState(hash="h")},
        running=not app.spec.suspend,
    )


@st.composite
def worlds(draw: st.DrawFn) -> tuple[App, list[Child], dict[ChildRef, Observed]]:
    """An app, what it wants, and children left by an earlier desired state of the same app, some missing, some bent."""
    app = draw(apps())
    wanted = draw(children(app))
    earlier = dataclasses.replace(app, spec=draw(apps()).spec)
    past = draw(children(earlier))
    observed = after(planned(earlier, past, {}), {}, earlier)
    for ref in sorted(observed):
        fate = draw(st.sampled_from(["kept", "kept", "lost", "bent"]))
        if fate == "lost":
            del observed[ref]
        elif fate == "bent":
            observed[ref] = bent(observed[ref])
    return app, wanted, observed


def bent(item: Observed) -> Observed:
    body = msgspec.to_builtins(item)
    body["spec"]["selector"] = {"somebody": "else"}
    return msgspec.convert(body, type(item))


def planned(app: App, wanted: list[Child], observed: dict[ChildRef, Observed]) -> Plan:
    return plan(app, wanted, observed, version=VERSION, settled={})


def foreign(app: App) -> dict[ChildRef, Observed]:
    """Objects of other owners with our labels, and without owners."""
    labels = {"robotics.io/app-uid": app.uid, "robotics.io/app": app.name}
    owner = {"kind": "RobotApp", "name": "x", "uid": "somebody", "controller": True}
    metas: list[dict[str, Any]] = [
        {"name": "theirs", "uid": "f1", "labels": labels, "ownerReferences": [owner]},
        {"name": "nobodys", "uid": "f2", "labels": labels},
        {"name": "ours-but-unlabelled", "uid": "f3", "ownerReferences": [owner | {"uid": app.uid}]},
    ]
    items: list[Observed] = []
    for meta in metas:
        items += [msgspec.convert({"metadata": meta}, Deployment), msgspec.convert({"metadata": meta}, Service)]
    return {ref_of(item): item for item in items}


@given(worlds())
@settings(deadline=None)
def test_after_its_own_plan_nothing_is_left_to_do(world: tuple[App, list[Child], dict[ChildRef, Observed]]) -> None:
    app, wanted, observed = world
    done = after(planned(app, wanted, observed), observed, app)
    assert not planned(app, wanted, done)
    assert set(done) == {child.ref for child in wanted}


@given(worlds(), st.randoms(use_true_random=False))
@settings(deadline=None)
def test_the_order_of_what_is_observed_does_not_matter(
    world: tuple[App, list[Child], dict[ChildRef, Observed]], random: Any
) -> None:
    app, wanted, observed = world
    items = list(observed.items())
    random.shuffle(items)
    assert planned(app, wanted, dict(items)) == planned(app, wanted, observed)


@given(worlds())
@settings(deadline=None)
def test_other_peoples_objects_change_nothing_and_are_never_deleted(
    world: tuple[App, list[Child], dict[ChildRef, Observed]],
) -> None:
    app, wanted, observed = world
    others = foreign(app)
    result = planned(app, wanted, observed | others)
    assert result == planned(app, wanted, observed)
    assert not {ref_of(item) for item in result.deletes} & set(others)


@given(worlds())
@settings(deadline=None)
def test_only_what_the_app_controls_is_ever_written_over_or_deleted(
    world: tuple[App, list[Child], dict[ChildRef, Observed]],
) -> None:
    app, wanted, observed = world
    result = planned(app, wanted, observed)
    touched = [*result.deletes, *(change.over for change in result.changes if change.over)]
    assert all(item.metadata.controller_uid == app.uid for item in touched)
    assert not {ref_of(item) for item in result.deletes} & {child.ref for child in wanted}


@given(worlds())
@settings(deadline=None)
def test_planning_is_deterministic(world: tuple[App, list[Child], dict[ChildRef, Observed]]) -> None:
    assert planned(*world) == planned(*world)


@given(apps().flatmap(children))
@settings(deadline=None)
def test_names_are_distinct_labels_the_api_server_accepts(wanted: list[Child]) -> None:
    names = [child.ref for child in wanted]
    assert len(set(names)) == len(names)
    assert all(len(ref.name) <= 63 and ref.name[0].isalpha() for ref in names)


@given(apps().flatmap(lambda app: st.tuples(st.just(app), children(app))))
@settings(deadline=None)
def test_every_component_with_ros2_of_an_instance_carries_the_same_domain_and_no_other_component_has_one(
    case: tuple[App, list[Child]],
) -> None:
    app, wanted = case
    domains: dict[str, str | None] = {}
    for child in wanted:
        if "robotics.io/component" not in child.labels:
            continue
        (main,) = child.spec["template"]["spec"]["containers"]
        domains[child.component] = next((v["value"] for v in main["env"] if v["name"] == "ROS_DOMAIN_ID"), None)
    with_ros2 = {part.name for part in app.ros_components} if app.ros_version == 2 else set()
    assert {name for name, domain in domains.items() if domain is not None} == with_ros2
    assert len({*domains.values()} - {None}) == bool(with_ros2)
