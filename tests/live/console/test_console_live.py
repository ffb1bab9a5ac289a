"""The console as the chart runs it, in front of a real API server: what a tenant and an administrator see."""

import re
from pathlib import Path

import pytest
from tests.live.console.browsing import Console, make_token

from robotapp_testbed import ControlPlane, wait_until

pytestmark = pytest.mark.live
EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
ROBOT = "amr-console"


def find_refused(page: str) -> str:
    """Returns the kinds that a page says it does not show."""
    return " ".join(re.findall(r"Not shown: ([^<]*)", page))


@pytest.mark.usefixtures("fleet")
def test_a_tenant_sees_its_apps_and_is_told_what_it_may_not_read(
    installed_plane: ControlPlane, console: Console, namespace: str
) -> None:
    installed_plane.kubectl("apply", "-n", namespace, "-f", str(EXAMPLES / "minimal.yaml"))
    token = make_token(installed_plane, namespace)
    console.cookies.clear()
    assert console.get("/")[0] == 303, "a browser without a session is sent to the form"
    assert console.sign_in("none of this cluster") in (401, 422)
    assert console.sign_in(token, namespace) == 303

    def is_shown() -> bool:
        return f'href="/apps/{namespace}/minimal"' in console.get("/")[1]

    assert wait_until(is_shown, timeout_s=30, poll_s=0.3), "the operator's instance is shown as a chip"
    status, page = console.get("/")
    assert status == 200
    assert f"system:serviceaccount:{namespace}:view" in page
    for kind in ("Nodes", "NodeTelemetries", "RobotClaims", "DomainPools"):
        assert kind in find_refused(page)
    assert "RobotApps" not in find_refused(page)
    assert token not in page
    assert ROBOT not in page
    status, app = console.get(f"/apps/{namespace}/minimal")
    assert status == 200
    assert "Accepted" in app
    assert "Not shown: events" not in app
    assert "Nodes" in find_refused(console.get("/nodes")[1])


@pytest.mark.usefixtures("fleet")
def test_who_may_read_the_cluster_sees_robots_nodes_and_round_trips(
    installed_plane: ControlPlane, console: Console, namespace: str
) -> None:
    token = make_token(installed_plane, namespace)
    for role in ("view", "robotapp-cluster-viewer"):
        binding = ("create", "clusterrolebinding", f"{namespace}-{role}", f"--clusterrole={role}")
        installed_plane.kubectl(*binding, f"--serviceaccount={namespace}:view")
    try:
        assert console.sign_in(token) == 303
        assert wait_until(lambda: "2 ms" in console.get("/")[1], timeout_s=30, poll_s=0.3)
        _, page = console.get("/")
        assert f'id="robot-{ROBOT}"' in page
        assert "Not shown" not in page
        _, nodes = console.get("/nodes")
        assert f'id="node-{ROBOT}"' in nodes
        assert "Not shown" not in nodes
        assert 'class="heat2"' in nodes
    finally:
        for role in ("view", "robotapp-cluster-viewer"):
            installed_plane.kubectl("delete", "clusterrolebinding", f"{namespace}-{role}")
