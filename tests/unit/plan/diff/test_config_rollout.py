"""What another content of ConfigMaps makes of an instance's children, from the first look of this version on."""

from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from typing import Any

import msgspec
from tests.support.factories import VERSION, after, component, make_app

from robotapp_api.model.names import Annotation
from robotapp_operator.plan.diff.config_rollout import ConfigRollout, plan_config
from robotapp_operator.plan.diff.diff import Observed, Plan, plan, wanted_children
from robotapp_operator.plan.render.child import DEPLOYMENT
from robotapp_operator.plan.render.parameters import parameter_states
from robotapp_operator.plan.spec.config_content import ClusterConfig
from robotapp_operator.plan.spec.desired import App, Domain, desired_of
from robotapp_operator.plan.spec.objects import ChildRef, ConfigMap, pod_annotations

NOW = datetime(2026, 5, 1, 12, tzinfo=UTC)
DOMAIN = Domain(7, "dds.default.c.7")
MOUNTED = component("driver", envFrom=[{"configMapRef": {"name": "drv"}}])
TUNED = component("driver", args=["run"], parameters=[{"configMapKeyRef": {"name": "drv", "key": "a"}}])
Children = Mapping[ChildRef, Observed]


def versions(**data: str) -> ClusterConfig:
    body = {"metadata": {"name": "drv"}, "data": data}
    return ClusterConfig({"default/drv": msgspec.convert(body, ConfigMap)} if data else {}, {})


def rendered_before(app: App, known: ClusterConfig) -> Children:
    """The children as an operator before this one left them: it recorded nothing."""
    states = parameter_states(app, "", known.config_maps)
    wanted = wanted_children(desired_of(app, ""), domain=DOMAIN, parameters=states, running=True)
    return after(plan(app, wanted, {}, version=VERSION, settled={}), {}, app)


def look(
    app: App, known: ClusterConfig, observed: Children, *, at: datetime = NOW, version: str = VERSION
) -> tuple[Plan, ConfigRollout]:
    rollout = plan_config(app, "", known, observed, now=at)
    running = not app.spec.suspend
    wanted = wanted_children(desired_of(app, ""), domain=DOMAIN, parameters=rollout.states, running=running)
    return plan(app, wanted, observed, version=version, settled={}), rollout


def templates(children: Children) -> dict[str, Any]:
    return {ref.name: item.spec["template"] for ref, item in children.items() if ref.kind == DEPLOYMENT}


def test_an_upgrade_records_what_is_there_and_starts_no_pod() -> None:
    for part in (MOUNTED, TUNED):
        app = make_app(part)
        before = rendered_before(app, versions(a="1"))
        changes, _ = look(app, versions(a="1"), before, version="1.3.0")
        (change,) = changes.changes
        assert change.child.spec["template"] == templates(before)[change.child.ref.name]
        recorded = after(changes, before, app, version="1.3.0")
        assert templates(recorded) == templates(before)
        assert not look(app, versions(a="1"), recorded, version="1.3.0")[0]


def test_an_app_without_config_maps_gets_no_record() -> None:
    app = make_app(component("driver"))
    before = rendered_before(app, versions())
    assert not look(app, versions(), before, version="1.3.0")[0]


def test_an_upgrade_is_not_held_because_of_the_record() -> None:
    app = make_app(MOUNTED, update={"operator": "OnDemand"})
    before = rendered_before(app, versions(a="1"))
    changes, _ = look(app, versions(a="1"), before, version="1.3.0")
    assert (len(changes.changes), changes.held) == (1, ())


def test_a_change_is_rolled_out_also_while_an_operators_own_changes_wait() -> None:
    app = make_app(MOUNTED, update={"operator": "OnDemand"})
    before = after(look(app, versions(a="1"), {})[0], {}, app)
    changes, _ = look(app, versions(a="2"), before, version="1.3.0")
    (change,) = changes.changes
    assert change.child.change == "ConfigMap drv"
    assert pod_annotations(change.child.spec)[Annotation.CONFIG_HASH]


def test_a_change_is_rolled_out_once_and_the_next_one_waits() -> None:
    for part in (MOUNTED, TUNED):
        app = make_app(part)
        first = after(look(app, versions(a="1"), {})[0], {}, app)
        second = after(look(app, versions(a="2"), first)[0], first, app)
        assert templates(second) != templates(first)
        assert not look(app, versions(a="2"), second)[0]
        changes, rollout = look(app, versions(a="3"), second, at=NOW + timedelta(seconds=1))
        assert not changes
        assert rollout.due == NOW + timedelta(seconds=10)
        assert rollout.held[0].startswith("driver: ConfigMap drv changed again after 1 restarts for changes")
        assert look(app, versions(a="3"), second, at=NOW + timedelta(seconds=10))[0].changes[0].child.change


def test_none_starts_nothing_and_an_edit_of_the_component_takes_what_there_is() -> None:
    app = make_app(MOUNTED, update={"onConfigChange": "None"})
    first = after(look(app, versions(a="1"), {})[0], {}, app)
    assert not look(app, versions(a="2"), first)[0]
    edited = make_app({**MOUNTED, "image": "x:2"}, update={"onConfigChange": "None"}, generation=2)
    (change,) = look(edited, versions(a="2"), first)[0].changes
    assert change.child.change == ""


def test_a_deleted_parameter_file_leaves_the_pods_as_they_are() -> None:
    """Their successors could not start."""
    app = make_app(TUNED)
    first = after(look(app, versions(a="1"), {})[0], {}, app)
    assert not look(app, versions(), first)[0]
    assert not look(app, versions(a="1"), first)[0]


def test_an_optional_file_that_appears_starts_the_component_anew() -> None:
    file = {"configMapKeyRef": {"name": "drv", "key": "b", "optional": True}}
    app = make_app(component("driver", args=["run"], parameters=[*TUNED["parameters"], file]))
    first = after(look(app, versions(a="1"), {})[0], {}, app)
    (change,) = look(app, versions(a="1", b="1"), first)[0].changes
    assert change.child.change == "ConfigMap drv"
    assert len(change.child.spec["template"]["spec"]["volumes"][0]["projected"]["sources"]) == 2


def test_a_suspended_app_takes_what_there_is_without_a_restart_being_counted() -> None:
    app = make_app(MOUNTED)
    first = after(look(app, versions(a="1"), {})[0], {}, app)
    suspended = make_app(MOUNTED, suspend=True, generation=2)
    changes, _ = look(suspended, versions(a="2"), first)
    assert [change.child.change for change in changes.changes] == [""]


def test_a_suspended_component_takes_what_there_is_and_is_not_said_to_start_anew() -> None:
    app = make_app({**MOUNTED, "replicas": 0}, component("panel"))
    first = after(look(app, versions(a="1"), {})[0], {}, app)
    changes, _ = look(app, versions(a="2"), first)
    assert [change.child.change for change in changes.changes] == [""]
    second = after(changes, first, app)
    resumed = make_app(MOUNTED, component("panel"), generation=2)
    resumption, rollout = look(resumed, versions(a="2"), second)
    assert [change.child.change for change in resumption.changes] == [""]
    assert not look(resumed, versions(a="2"), after(resumption, second, resumed), at=NOW + timedelta(hours=1))[0]
    assert rollout.due is None


def test_secrets_that_are_not_followed_for_a_moment_start_nothing_and_a_change_meanwhile_is_seen() -> None:
    """Each start of the operator plans before it has the Secrets' versions, and a question about its rights may fail."""
    secret = {"secretRef": {"name": "key"}}
    app = make_app(component("driver", envFrom=[secret]), component("map", envFrom=[secret, *MOUNTED["envFrom"]]))

    def known(version: str) -> ClusterConfig:
        return ClusterConfig(versions(a="1").config_maps, {"default": {"key": version}} if version else {})

    first = after(look(app, known("1"), {})[0], {}, app)
    second = after(look(app, known("2"), first)[0], first, app)
    assert templates(second) != templates(first)
    later = NOW + timedelta(minutes=5)
    assert not look(app, known(""), second, at=later)[0]
    assert not look(app, known("2"), second, at=later)[0]
    assert {change.child.change for change in look(app, known("3"), second, at=later)[0].changes} == {"Secret key"}
    without = make_app(component("driver"), component("map"), generation=2)
    assert len(look(without, known(""), second, at=later)[0].changes) == 2, "an edit takes the record with it"


def test_a_lost_record_starts_nothing() -> None:
    app = make_app(MOUNTED)
    first = after(look(app, versions(a="1"), {})[0], {}, app)
    second = after(look(app, versions(a="2"), first)[0], first, app)
    for item in second.values():
        item.metadata.annotations.pop(Annotation.CONFIG, None)
    changes, _ = look(app, versions(a="2"), second)
    assert templates(after(changes, second, app)) == templates(second)
