"""Whatever replaces the pod of a single-replica component: there is one publisher, but where `Failover` lets two run for a while."""

import secrets
from collections.abc import Iterator

import pytest
from tests.support.seeds import daily_seed

from campaigns.operating import replacements
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane import product

REPLACEMENTS = 12
"""Of 200 in the long run (scripts/bench replacements): two of each force."""


@pytest.fixture
def _operating(installed_plane: ControlPlane) -> Iterator[None]:
    scheduler = product.start_scheduler(installed_plane, sweep_seconds=1)
    operator = product.start_operator(
        installed_plane, name=f"operator-{secrets.token_hex(2)}", sweep_seconds=1, no_leader_election=True
    )
    yield
    operator.stop()
    scheduler.stop()


@pytest.mark.usefixtures("_operating")
def test_pods_replaced_by_force_never_overlap_against_what_on_disconnect_promises(
    installed_plane: ControlPlane, namespace: str
) -> None:
    seed = daily_seed()
    report = replacements.run(
        installed_plane, namespace, replacements=REPLACEMENTS, lanes=len(replacements.KINDS), seed=seed
    )
    assert report.problems == [], f"seed {seed}"
    assert set(report.by_force.values()) == {REPLACEMENTS // len(replacements.FORCES)}
