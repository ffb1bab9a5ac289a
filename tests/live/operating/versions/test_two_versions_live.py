"""An upgrade on its way: one program, or the CRDs, are of version N+1 (a wheel of its own), the rest is of version N.

Each of the three is a whole life of an app. They take turns by the day; ROBOTAPP_SAMPLES=all takes all of them.
"""

import os
import secrets
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from typing import Any

import pytest
from tests.live.operating.versions import newer_wheel
from tests.support.seeds import choose_for_today

from campaigns.rigs.appwatch import condition
from campaigns.rigs.live import eventually
from campaigns.rigs.simulated_site import SimulatedSite, plain_app
from robotapp_api.model.names import Annotation, Label
from robotapp_operator import __version__
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane import product
from robotapp_testbed.machines.network import Topology
from robotapp_testbed.machines.topology import edge, robot

pytestmark = pytest.mark.live
NEWER = newer_wheel.next_version()
PARTS = ("sense", "act")
SOON_S = 15.0
"""Seconds for an edit to act: one or two on an idle machine."""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, str]:
    """Environment in which a program is of version N+1."""
    env = {"PYTHONPATH": str(newer_wheel.unpacked(tmp_path_factory.mktemp("newer")))}
    for program in ("operator", "scheduler"):
        where = f"import robotapp_{program}; print(robotapp_{program}.__file__)"
        found = subprocess.run(
            [sys.executable, "-c", where], env={**os.environ, **env}, check=True, capture_output=True, text=True
        )
        assert found.stdout.startswith(env["PYTHONPATH"])
    return env


@contextmanager
def newer_crds(cp: ControlPlane) -> Iterator[None]:
    product.define(cp, newer_wheel.crds(newer=True))
    try:
        yield
    finally:
        product.define(cp, newer_wheel.crds(newer=False))


def life_of_an_app(world: SimulatedSite, pool: str) -> tuple[dict[str, Any], set[str]]:
    """It gets ready, stops and starts as the user says, and is gone with all that it had. Returns the app as it was when it was
    ready, and which versions of the operator rendered its children.
    """
    anywhere = {"matchExpressions": [{"key": str(Label.ROBOT), "operator": "Exists"}]}
    world.create(plain_app("life", parts=PARTS, ros2={"pool": pool}, robots={"nodeSelector": anywhere}))
    world.watch.until_ready("life", within_s=60)
    ready = world.app("life")
    assert len(world.claims(pool)) == 1
    deployments = world.cp.api.get(f"/apis/apps/v1/namespaces/{world.namespace}/deployments")["items"]
    rendered = {item["metadata"]["annotations"][str(Annotation.RENDERED_BY)] for item in deployments}
    suspend(world, "true")
    eventually(lambda: not world.pods(), timeout_s=SOON_S, what=world.pods)
    suspend(world, "false")
    eventually(lambda: world.app("life")["status"]["phase"] == "Running", what=lambda: world.app("life")["status"])
    assert all(pod["spec"]["nodeName"] for pod in world.pods())
    world.clear()
    return ready, rendered


def suspend(world: SimulatedSite, value: str) -> None:
    world.kubectl("patch", "ra", "life", "--type=merge", "-p", f'{{"spec": {{"suspend": {value}}}}}')


@pytest.mark.parametrize("case", choose_for_today(["newer scheduler", "newer operator", "newer CRDs"]))
def test_an_app_lives_while_versions_are_mixed(
    installed_plane: ControlPlane, request: pytest.FixtureRequest, case: str
) -> None:
    mark = secrets.token_hex(2)
    pools = {f"mixed-{mark}": "1-3"}
    nodes = Topology([robot(f"amr-{mark}"), edge(f"edge-{mark}")])
    flags: dict[str, Any] = {}
    with ExitStack() as stack:
        if case == "newer CRDs":
            stack.enter_context(newer_crds(installed_plane))
        else:
            kind = "scheduler_flags" if case == "newer scheduler" else "operator_flags"
            flags[kind] = {"env": request.getfixturevalue("wheel")}
        world = stack.enter_context(SimulatedSite(installed_plane, nodes, pools=pools, **flags))
        ready, rendered = life_of_an_app(world, *pools)
    assert rendered == {NEWER if case == "newer operator" else __version__}
    stored = {part.get(newer_wheel.LATER) for part in ready["spec"]["components"]}
    assert stored == {"x" if case == "newer CRDs" else None}, "the newer schema's default is in every app"
    later_fields = f"spec.components[].{newer_wheel.LATER}, spec.later"
    unknown = f"{later_fields}: without effect, because this operator is older than the CRD"
    assert (unknown in condition(ready, "Accepted")["message"]) == (case == "newer CRDs")


def test_older_crds_take_the_fields_they_lack_at_the_next_write_and_leave_everything_else(
    installed_plane: ControlPlane,
) -> None:
    """What the page about upgrades says: the API server erases them, whoever writes; a saved copy brings them back."""
    mark = secrets.token_hex(2)
    pool = f"narrow-{mark}"
    nodes = Topology([robot(f"amr-{mark}"), edge(f"edge-{mark}")])
    written = {"onDisconnect": "Stop", newer_wheel.LATER: "mine"}
    app = plain_app("narrow", parts=PARTS, ros2={"pool": pool}, placement={"objective": "Balance"})
    app["spec"]["components"][0] |= written
    with newer_crds(installed_plane), SimulatedSite(installed_plane, nodes, pools={pool: "1-3"}) as world:
        world.create(app)
        world.watch.until_ready("narrow", within_s=60)
        saved = world.app("narrow")
        product.define(installed_plane, newer_wheel.crds(newer=False))
        eventually(lambda: newer_wheel.LATER not in world.app("narrow")["spec"]["components"][0])
        world.kubectl("patch", "ra", "narrow", "--type=merge", "-p", '{"spec": {"suspend": true}}')
        eventually(lambda: not world.pods(), timeout_s=SOON_S, what=world.pods)
        product.define(installed_plane, newer_wheel.crds(newer=True))
        now = eventually(lambda: newer_wheel.LATER in (app := world.app("narrow"))["spec"]["components"][0] and app)
        assert now["spec"]["components"][0][newer_wheel.LATER] == "x", "the older CRD erased what the user wrote"
        assert now["spec"]["components"][0]["onDisconnect"] == "Stop"
        assert now["spec"]["placement"]["objective"] == "Balance"
        world.kubectl("apply", "--server-side", "--force-conflicts", "-f", "-", stdin=saved_copy(saved))
        assert world.app("narrow")["spec"]["components"][0][newer_wheel.LATER] == "mine"


def saved_copy(app: Mapping[str, Any]) -> dict[str, Any]:
    """What `kubectl get -o yaml` saved, without what the server gives each object."""
    meta = {key: app["metadata"][key] for key in ("name", "namespace")}
    return {"apiVersion": app["apiVersion"], "kind": app["kind"], "metadata": meta, "spec": app["spec"]}
