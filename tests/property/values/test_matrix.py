"""Rules of a sweep: which instances it has, what they are called, and which of them run next."""

import re
from typing import NamedTuple

from hypothesis import given
from hypothesis import strategies as st

from robotapp_api.model.patterns import LABEL_PATTERN
from robotapp_api.values.sweeps.matrix import (
    MOST_INSTANCES,
    choose_admitted,
    count_instances,
    expand_matrix,
    limit_domains,
    list_variables,
    name_variable,
)

NAMES = st.from_regex(r"[a-z][a-z0-9_]{0,8}", fullmatch=True)
VALUES = st.lists(st.text(min_size=1, max_size=12), min_size=1, max_size=6, unique=True)
PARAMETERS = st.dictionaries(NAMES, VALUES, min_size=1, max_size=4)


def matrix(parameters: dict[str, list[str]]) -> dict[str, object]:
    return {"parameters": [{"name": name, "values": values} for name, values in parameters.items()]}


@given(PARAMETERS)
def test_every_combination_is_an_instance_with_a_name_of_its_own(parameters: dict[str, list[str]]) -> None:
    written = matrix(parameters)
    instances = expand_matrix(written)
    assert len(instances) == (count_instances(written) if count_instances(written) <= MOST_INSTANCES else 0)
    assert len({instance.name for instance in instances}) == len(instances)
    assert all(re.fullmatch(LABEL_PATTERN, instance.name) and len(instance.name) <= 49 for instance in instances)
    assert all(instance.values[name] in values for instance in instances for name, values in parameters.items())


@given(PARAMETERS, st.randoms())
def test_names_stay_when_parameters_and_values_are_written_in_another_order(
    parameters: dict[str, list[str]], random: object
) -> None:
    shuffled = list(parameters.items())
    random.shuffle(shuffled)  # type: ignore[attr-defined]
    other = {name: list(reversed(values)) for name, values in shuffled}
    assert {instance.name for instance in expand_matrix(matrix(parameters))} == {
        instance.name for instance in expand_matrix(matrix(other))
    }


@given(PARAMETERS, st.text(min_size=13, max_size=14))
def test_instances_keep_their_names_when_a_value_is_added(parameters: dict[str, list[str]], value: str) -> None:
    first = next(iter(parameters))
    more = {**parameters, first: [*parameters[first], value]}
    if count_instances(matrix(more)) <= MOST_INSTANCES:
        assert {instance.name for instance in expand_matrix(matrix(parameters))} < {
            instance.name for instance in expand_matrix(matrix(more))
        }


@given(PARAMETERS)
def test_each_instance_has_a_variable_for_each_parameter(parameters: dict[str, list[str]]) -> None:
    for instance in expand_matrix(matrix(parameters)):
        assert list_variables(instance.values) == {name_variable(name): instance.values[name] for name in parameters}


@given(
    st.lists(st.integers(0, 40), unique=True, max_size=30),
    st.integers(1, 12),
    st.sets(st.integers(0, 40)),
    st.sets(st.integers(0, 40)),
)
def test_no_more_than_the_parallelism_run_unless_more_had_begun(
    numbers: list[int], parallelism: int, begun: set[int], finished: set[int]
) -> None:
    names = [f"run-{number}" for number in numbers]
    has_begun = frozenset(f"run-{number}" for number in begun)
    is_finished = frozenset(f"run-{number}" for number in finished)
    admitted = choose_admitted(names, parallelism=parallelism, begun=has_begun, finished=is_finished)
    running = {name for name in names if name in has_begun - is_finished}
    unfinished = [name for name in names if name not in is_finished]
    assert running <= admitted <= set(unfinished)
    assert len(admitted) == max(len(running), min(parallelism, len(unfinished)))
    started = [name for name in unfinished if name not in running]
    assert [name for name in started if name in admitted] == started[: len(admitted) - len(running)]


@given(st.integers(1, 60), st.integers(1, 12), st.randoms())
def test_a_sweep_ends_whatever_order_its_instances_finish_in(count: int, parallelism: int, random: object) -> None:
    names = [f"run-{number}" for number in range(count)]
    begun: frozenset[str] = frozenset()
    finished: frozenset[str] = frozenset()
    for _ in range(count):
        admitted = choose_admitted(names, parallelism=parallelism, begun=begun, finished=finished)
        assert 0 < len(admitted) <= parallelism
        begun |= admitted
        finished |= {random.choice(sorted(admitted))}  # type: ignore[attr-defined]
    assert finished == set(names)
    assert choose_admitted(names, parallelism=parallelism, begun=begun, finished=finished) == frozenset()


class Load(NamedTuple):
    """A sweep and another app in one pool, in seconds. held: ids that nobody gives back."""

    pool: int
    held: int
    parallelism: int
    runs: list[int]
    rest: int
    arrival: int
    stay: int


LOADS = st.integers(1, 14).flatmap(
    lambda pool: st.builds(
        Load,
        pool=st.just(pool),
        held=st.integers(0, pool - 1),
        parallelism=st.integers(1, 20),
        runs=st.lists(st.integers(1, 5), min_size=1, max_size=30),
        rest=st.integers(1, 8),
        arrival=st.integers(0, 40),
        stay=st.integers(1, 20),
    )
)


@given(LOADS)
def test_another_app_gets_a_domain_as_soon_as_one_has_rested_and_the_sweep_goes_on(load: Load) -> None:
    names = [f"run-{number}" for number in range(len(load.runs))]
    ends: dict[str, int] = {}
    rests: list[int] = []
    finished: set[str] = set()
    granted: int | None = None
    limit = limit_domains(load.parallelism, load.pool)
    turn_s = max(load.runs) + load.rest
    for now in range(load.arrival + load.stay + turn_s * (len(names) + 2)):
        for name in [name for name, end in ends.items() if end <= now]:
            del ends[name]
            finished.add(name)
            rests.append(now + load.rest)
        rests = [end for end in rests if end > now]
        is_there = granted is not None and now < granted + load.stay
        free = load.pool - load.held - len(ends) - len(rests) - is_there
        if granted is None and now >= load.arrival and free:
            granted, free = now, free - 1
        admitted = choose_admitted(
            names,
            parallelism=load.parallelism,
            begun=frozenset(ends),
            finished=frozenset(finished),
            resting=len(rests),
            available=load.pool,
        )
        starting = [name for name in names if name in admitted and name not in ends][:free]
        ends |= {name: now + load.runs[names.index(name)] for name in starting}
        assert len(ends) + len(rests) <= limit
    assert finished == set(names)
    assert granted is not None
    waited = granted - load.arrival
    assert waited <= turn_s
    if load.parallelism < load.pool and not load.held and load.pool > 1:
        assert waited == 0, "a sweep that runs fewer at once than there are domains leaves one free"


@given(st.integers(1, 300), st.integers(0, 300))
def test_a_sweep_holds_half_of_the_pool_or_what_runs_at_once_and_never_none(parallelism: int, available: int) -> None:
    limit = limit_domains(parallelism, available)
    assert 1 <= limit <= max(1, available)
    assert limit >= min(parallelism, available)
    assert limit <= max(parallelism, available // 2)
