"""What the API server's rules accept and what our own parsers accept is the same."""

import re

from hypothesis import given
from hypothesis import strategies as st
from tests.support.apiobjects import app, pool
from tests.support.schemas import broken_rules

from robotapp_api.model.app.robotapp import RobotApp
from robotapp_api.model.patterns import DURATION_PATTERN
from robotapp_api.model.pool import DomainPool
from robotapp_api.schema.crd import schema_of
from robotapp_api.values.cel import compile_expression
from robotapp_api.values.cel.values import Duration
from robotapp_api.values.quantities.duration import MAX_LENGTH, parse_ns
from robotapp_api.values.quantities.ranges import parse_ids

READ_DURATION = compile_expression("duration(text)", frozenset({"text"}))
POOL = schema_of(DomainPool)
ROBOTAPP = schema_of(RobotApp)
IN_WORDS = "write a number and a unit (us, ms, s, m or h), up to three times, for example 30ms, 1.5s or 1m30s"
IDS = re.compile(POOL["properties"]["spec"]["properties"]["ids"]["pattern"])
BOUNDS = st.integers(0, 240)
RANGES = st.lists(
    st.one_of(BOUNDS.map(str), st.tuples(BOUNDS, BOUNDS).map(lambda pair: f"{pair[0]}-{pair[1]}")), max_size=4
)


@given(RANGES.map(",".join))
def test_a_pool_accepts_exactly_the_ranges_we_can_read(text: str) -> None:
    assert IDS.fullmatch(text)
    accepted = not broken_rules(POOL, pool(ids=text))
    try:
        parse_ids(text)
    except ValueError:
        assert not accepted
    else:
        assert accepted


@given(RANGES.map(",".join), RANGES.map(",".join))
def test_a_pool_refuses_exactly_the_ids_that_are_both_claimed_and_shared(ids: str, shared: str) -> None:
    try:
        overlap = set(parse_ids(ids)) & set(parse_ids(shared))
    except ValueError:
        return
    assert bool(broken_rules(POOL, pool(ids=ids, sharedIds=shared))) == bool(overlap)


@given(
    st.one_of(
        st.from_regex(DURATION_PATTERN, fullmatch=True),
        st.text(alphabet="0123456789.smhu ", max_size=24),
        st.from_regex(r"[0-9]{1,7}[.]?[0-9]{0,4} ?(us|ms|s|m|h|d|ns)?", fullmatch=True),
    ).filter(lambda text: text.isascii() and len(text) <= MAX_LENGTH)
)
def test_the_api_accepts_exactly_the_durations_we_can_read(text: str) -> None:
    broken = [each.shown for each in broken_rules(ROBOTAPP, app(connectivity={"grace": text}))]
    try:
        parse_ns(text)
        problem = ""
    except ValueError as error:
        problem = str(error)
    readable = not problem or "292 years" in problem
    assert broken == ([] if readable else [IN_WORDS])


@given(st.from_regex(DURATION_PATTERN, fullmatch=True).filter(lambda text: len(text) <= 24 and text.isascii()))
def test_durations_mean_the_same_in_rules_and_in_python(text: str) -> None:
    try:
        nanoseconds = parse_ns(text)
    except ValueError:
        return
    if nanoseconds < 2**53:
        assert READ_DURATION.evaluate({"text": text}) == Duration(nanoseconds)
