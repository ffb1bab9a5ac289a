"""Laws of dependsOn: every order without a circle starts all components, each after those it waits for, and stops none."""

from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from tests.support.factories import component, make_app
from tests.unit.plan.spec.test_dependencies import deployment

from robotapp_api.checks.spec import find_circle
from robotapp_operator.plan.spec.dependencies import unmet_dependencies
from robotapp_operator.plan.spec.desired import App

NAMES = [f"c{number}" for number in range(6)]
GRAPHS = st.dictionaries(st.sampled_from(NAMES), st.lists(st.sampled_from(NAMES), unique=True, max_size=3))


def app_of(graph: dict[str, list[str]]) -> App:
    parts: list[dict[str, Any]] = [
        component(name, dependsOn=[{"component": other} for other in graph.get(name, ())]) for name in NAMES
    ]
    return make_app(*parts)


def reaches(graph: dict[str, list[str]], start: str) -> set[str]:
    """Returns every name that `start` waits for, directly or through others."""
    reached: set[str] = set()
    waiting = [*graph.get(start, ())]
    while waiting:
        name = waiting.pop()
        if name not in reached:
            reached.add(name)
            waiting += graph.get(name, ())
    return reached


@given(GRAPHS)
def test_a_circle_is_named_exactly_where_there_is_one(graph: dict[str, list[str]]) -> None:
    circle = find_circle(graph)
    assert bool(circle) == any(name in reaches(graph, name) for name in NAMES)
    assert all(after in graph[name] for name, after in zip(circle, [*circle[1:], *circle[:1]], strict=True))


@given(GRAPHS, st.randoms())
def test_without_a_circle_all_start_each_after_those_it_waits_for(graph: dict[str, list[str]], random: Any) -> None:
    app, running = app_of(graph), dict[str, bool]()
    started: list[str] = []
    while True:
        unmet = unmet_dependencies(app, [deployment(name, ready=ready) for name, ready in running.items()])
        new = [name for name in NAMES if name not in unmet and name not in running]
        started += new
        running |= dict.fromkeys(new, False)
        starting = [name for name, ready in running.items() if not ready]
        if not starting:
            break
        running[random.choice(starting)] = True
    blocked = {name for name in NAMES if any(part in reaches(graph, part) for part in {name, *reaches(graph, name)})}
    assert set(started) == {*NAMES} - blocked
    assert all(started.index(other) < started.index(name) for name in started for other in graph.get(name, ()))


@given(GRAPHS, st.sets(st.sampled_from(NAMES)), st.sets(st.sampled_from(NAMES)))
def test_what_runs_never_waits_again(graph: dict[str, list[str]], running: set[str], ready: set[str]) -> None:
    items = [deployment(name, ready=name in ready) for name in sorted(running)]
    assert not unmet_dependencies(app_of(graph), items).keys() & running
