"""Traces are read strictly: every error names the path of what is wrong."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotapp_testbed.switch.traces import Trace, TraceError


@pytest.mark.parametrize(
    ("text", "path", "problem"),
    [
        ("steps: [", "", "this is not YAML"),
        ("at_s: 2026-13-45", "", "this is not YAML: month must be in 1..12"),
        ("[" * 100_000, "", "this is not YAML"),
        ("steps: []\nsteps: []", "", 'line 2: key "steps" already set in map'),
        (f"steps: [{{at_s: 1{'0' * 400}, links: [{{node: a, down: true}}]}}]", "steps[0].at_s", "a number of seconds"),
        ("[]", "", "not nothing"),
        ("{}", "steps", "not nothing"),
        ("steps: []", "steps", "at least one entry"),
        ("steps: 3", "steps", "not int"),
        ("stepz: []", "stepz", "known are steps, repeat_every_s"),
        ("steps: [1]", "steps[0]", "not int"),
        ("steps: [{links: [{node: a, down: true}]}]", "steps[0].at_s", "missing"),
        ("steps: [{at_s: -1, links: [{node: a, down: true}]}]", "steps[0].at_s", "-1"),
        ("steps: [{at_s: true, links: [{node: a, down: true}]}]", "steps[0].at_s", "True"),
        ("steps: [{at_s: 0}]", "steps[0].links", "not nothing"),
        ("steps: [{at_s: 0, links: [{node: a}]}]", "steps[0].links[0]", "nothing is set"),
        ("steps: [{at_s: 0, links: [{node: a, delay: 1}]}]", "steps[0].links[0].delay", "no such field"),
        ("steps: [{at_s: 0, links: [{node: a, loss: 2}]}]", "steps[0].links[0].loss", "2 is not between 0 and 1"),
        ("steps: [{at_s: 0, links: [{node: a, loss: .nan}]}]", "steps[0].links[0].loss", "nan"),
        ("steps: [{at_s: 0, links: [{node: a, delay_ms: 1s}]}]", "steps[0].links[0].delay_ms", "'1s'"),
        ("steps: [{at_s: 0, links: [{node: a, down: 1}]}]", "steps[0].links[0].down", "neither true nor false"),
        ("steps: [{at_s: 0, links: [{node: 3, down: true}]}]", "steps[0].links[0].node", "3 is not the name"),
        ("steps: [{at_s: 0, links: [{down: true}]}]", "steps[0].links[0]", "say which links"),
        ("steps: [{at_s: 0, links: [{node: a, from: b, down: true}]}]", "steps[0].links[0]", "say which links"),
        ("steps: [{at_s: 0, links: [{between: [a], down: true}]}]", "steps[0].links[0].between", "here are 1"),
        ("steps: [{at_s: 0, links: [{between: [a, a], down: true}]}]", "steps[0].links[0]", "itself"),
        ("steps: [{at_s: 0, links: [{between: [a, 4], down: true}]}]", "steps[0].links[0].between[1]", "4"),
        (
            "steps: [{at_s: 5, links: [{node: a, down: true}]}, {at_s: 4, links: [{node: a, down: false}]}]",
            "steps[1].at_s",
            "before the step above",
        ),
        (
            "{steps: [{at_s: 5, links: [{node: a, down: true}]}], repeat_every_s: 5}",
            "repeat_every_s",
            "not after the last",
        ),
    ],
)
def test_what_is_wrong_is_named_by_its_path(text: str, path: str, problem: str) -> None:
    with pytest.raises(TraceError) as raised:
        Trace.parse(text)
    assert raised.value.path == path
    assert problem in str(raised.value)
    assert str(raised.value).startswith(path)


@given(
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
        lambda inner: (
            st.lists(inner)
            | st.dictionaries(
                st.sampled_from(["steps", "at_s", "links", "node", "from", "to", "between", "loss", "down", "x"]), inner
            )
        ),
    )
)
def test_no_tree_is_answered_with_anything_but_a_trace_or_a_trace_error(tree: object) -> None:
    try:
        trace = Trace.from_tree(tree)
    except TraceError:
        return
    assert trace.steps
