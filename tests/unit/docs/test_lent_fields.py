"""What a RobotApp lends its writer: the chart's allow-lists have every plain field of the CRD, and no other."""

from collections.abc import Iterator
from typing import Any

import pytest
from tests.live.attacks.table.lending import FREE_FIELDS, LEVELS, PLAIN, fields_at, lending_paths, robotapp_spec

LOOKED_AT = {"serviceAccountName", "imagePullSecrets", "priorityClassName"}
"""Fields whose values the policy looks at: an empty one lends nothing."""
CONTAINERS = (LEVELS["initContainers"], f"{LEVELS['podSpec']}.containers")
HELPERS = ("ros1", "ros2.discovery")
"""Where the spec describes pods of the operator's own: a master, discovery servers."""


def test_every_level_of_the_charts_lists_is_one_of_the_crd() -> None:
    assert FREE_FIELDS.keys() == LEVELS.keys()


@pytest.mark.parametrize("level", LEVELS)
def test_the_policy_leaves_a_writer_the_plain_fields_and_no_other(level: str) -> None:
    """A field of a later Kubernetes is in neither set, so it is lent to nobody and this test says that it wants reading."""
    assert set(FREE_FIELDS[level]) - LOOKED_AT == fields_at(LEVELS[level]) & PLAIN


def test_every_object_below_which_something_is_lent_has_a_level() -> None:
    """The policy looks at these places alone; `windowsOptions` and the three looked-at fields have a variable of their own."""
    parents = {path.rpartition(".")[0].removeprefix("spec.") for path in lending_paths(robotapp_spec(), "spec")}
    windows = {f"{parent}.securityContext" for parent in ("components", LEVELS["podSpec"], *CONTAINERS)}
    helpers = {
        f"{helper}{place}"
        for helper in HELPERS
        for place in (".securityContext", ".template.spec", ".template.spec.securityContext")
    }
    further = {f"{place}{field}" for place in CONTAINERS for field in (".env.valueFrom", ".envFrom")}
    overrides = {f"{LEVELS['overriddenComponents']}.env.valueFrom", f"{LEVELS['overriddenComponents']}.parameters"}
    assert parents == {*LEVELS.values(), *windows, *helpers, *further, *overrides} - {
        "overrides",
        LEVELS["overriddenComponents"],
        "components",
        "components.template",
        LEVELS["initContainers"],
        *HELPERS,
    }


def test_further_containers_have_the_fields_of_init_containers_by_whose_list_they_are_looked_at() -> None:
    first, second = map(fields_at, CONTAINERS)
    assert first == second


@pytest.mark.parametrize("helper", HELPERS)
def test_templates_of_helpers_have_the_fields_of_the_levels_they_are_looked_at_by(helper: str) -> None:
    """Discovery servers and master have one list for their pods, and the list of components for their templates."""
    assert fields_at(f"{helper}.template") == set(FREE_FIELDS["template"])
    assert fields_at(f"{helper}.template.spec") == set(FREE_FIELDS["helperPod"])


def test_no_plain_name_is_kept_that_the_crd_no_longer_has() -> None:
    assert set(names_of(robotapp_spec())) >= PLAIN


def names_of(schema: dict[str, Any]) -> Iterator[str]:
    """Names of all fields in a schema."""
    properties = schema.get("properties", {})
    yield from properties
    for member in (*properties.values(), schema.get("items"), schema.get("additionalProperties")):
        if member:
            yield from names_of(member)
