"""Foreign domains in our templates are found wherever they hide, and can be removed one after the other."""

import copy
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from robotapp_operator.plan.diff.unowned import unowned_pointers

VARIABLE = "ROS_DOMAIN_ID"


def spec(*, containers: list[list[tuple[str, str]]], init: list[list[tuple[str, str]]] | None = None) -> dict[str, Any]:
    """A Deployment spec; per container its variables."""

    def made(listed: list[list[tuple[str, str]]]) -> list[dict[str, Any]]:
        return [{"name": f"c{i}", "env": [{"name": n, "value": v} for n, v in env]} for i, env in enumerate(listed)]

    return {"template": {"spec": {"containers": made(containers), "initContainers": made(init or [])}}}


OURS = spec(containers=[[("A", "1"), (VARIABLE, "7")]], init=[[]])


def test_what_we_wrote_is_no_stray() -> None:
    assert unowned_pointers(OURS, OURS) == []


def test_a_foreign_domain_is_found_in_every_kind_of_container_last_first() -> None:
    live = spec(containers=[[("A", "1"), (VARIABLE, "7")], [(VARIABLE, "99")]], init=[[("B", "2"), (VARIABLE, "98")]])
    assert unowned_pointers(live, OURS) == [
        "/spec/template/spec/containers/1/env/0",
        "/spec/template/spec/initContainers/0/env/1",
    ]


def test_our_own_number_elsewhere_does_no_harm() -> None:
    assert unowned_pointers(spec(containers=[[(VARIABLE, "7")]], init=[[(VARIABLE, "7")]]), OURS) == []


def test_a_template_of_ours_without_domain_wants_none() -> None:
    assert unowned_pointers(spec(containers=[[(VARIABLE, "0")]]), spec(containers=[[]])) == [
        "/spec/template/spec/containers/0/env/0"
    ]


def test_odd_specs_have_no_strays() -> None:
    assert unowned_pointers({}, OURS) == []
    assert unowned_pointers({"template": None}, OURS) == []
    assert unowned_pointers({"template": {"spec": {"containers": [{"env": None}, {}]}}}, OURS) == []
    reference = {"name": VARIABLE, "valueFrom": {"fieldRef": {"fieldPath": "metadata.name"}}}
    assert unowned_pointers({"template": {"spec": {"containers": [{"env": [reference]}]}}}, OURS) == []


_ENV = st.lists(st.tuples(st.sampled_from([VARIABLE, "A"]), st.sampled_from(["7", "8", "99", ""])), max_size=4)


@given(containers=st.lists(_ENV, max_size=3), init=st.lists(_ENV, max_size=3))
def test_removing_in_the_order_given_leaves_exactly_what_is_not_foreign(
    containers: list[list[tuple[str, str]]], init: list[list[tuple[str, str]]]
) -> None:
    live = spec(containers=containers, init=init)
    mended: Any = copy.deepcopy(live)
    for pointer in unowned_pointers(live, OURS):
        *path, last = pointer.split("/")[2:]
        target = mended
        for step in path:
            target = target[int(step) if step.isdecimal() else step]
        del target[int(last)]
    assert unowned_pointers(mended, OURS) == []
    kept = [[pair for pair in env if pair[0] != VARIABLE or pair[1] in {"7", ""}] for env in (*containers, *init)]
    pod = mended["template"]["spec"]
    found = [[(v["name"], v["value"]) for v in c["env"]] for c in (*pod["containers"], *pod["initContainers"])]
    assert found == kept
