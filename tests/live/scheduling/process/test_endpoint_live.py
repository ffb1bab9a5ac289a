"""The scheduler's TLS port as users of the cluster meet it: tokens, client certificates, and what each may see."""

import json
import ssl
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from campaigns.rigs.ports import ask, token
from campaigns.rigs.stage import Stage, nodes, pod
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane.authority import Authority
from robotapp_testbed.control_plane.product import start_scheduler
from robotapp_testbed.control_plane.servers import unverified
from robotapp_testbed.failures import ApiStatusError
from robotapp_testbed.machines.nodes import edge
from robotapp_testbed.processes.process import Process

pytestmark = pytest.mark.live

PUBLISHED = "/api/v1/namespaces/kube-system/configmaps/extension-apiserver-authentication"


@pytest.fixture(scope="module")
def authority(installed_plane: ControlPlane) -> Iterator[Authority]:
    """An authority of client certificates, published as the API server publishes its own."""
    made = Authority()
    name = PUBLISHED.rpartition("/")[2]
    body = {"metadata": {"name": name}, "data": {"client-ca-file": made.pem}}
    try:
        installed_plane.api.create(PUBLISHED.rpartition("/")[0], body)
    except ApiStatusError:
        installed_plane.api.patch(PUBLISHED, {"data": body["data"]})
    yield made
    installed_plane.api.patch(PUBLISHED, {"data": {"client-ca-file": None}})


@pytest.fixture(scope="module")
def guarded(installed_plane: ControlPlane, authority: Authority) -> Iterator[Process]:
    """A scheduler that asks who you are."""
    assert authority.pem
    process = start_scheduler(installed_plane, name="guarded", sweep_seconds=1, log_format="text")
    yield process
    process.stop()


def get(scheduler: Process, path: str, *, bearer: str = "", context: ssl.SSLContext | None = None) -> tuple[int, Any]:
    status, text = ask(f"{scheduler.health_url}{path}", bearer=bearer, context=context)
    return status, json.loads(text)


def allow(stage: Stage, user: str) -> None:
    """`user` may get pods in the stage's namespace, and nobody asked before it holds: answers are remembered for seconds."""
    api, group = "/apis/rbac.authorization.k8s.io/v1", "rbac.authorization.k8s.io"
    inside = f"{api}/namespaces/{stage.namespace}"
    rules = [{"apiGroups": [""], "resources": ["pods"], "verbs": ["get"]}]
    stage.cp.api.create(f"{inside}/roles", {"metadata": {"name": "reader"}, "rules": rules})
    body = {
        "metadata": {"name": "reader"},
        "roleRef": {"apiGroup": group, "kind": "Role", "name": "reader"},
        "subjects": [{"apiGroup": group, "kind": "User", "name": user}],
    }
    stage.cp.api.create(f"{inside}/rolebindings", body)
    may = ("auth", "can-i", "get", "pods", "-n", stage.namespace, f"--as={user}")
    stage.wait(lambda: stage.cp.kubectl(*may, check=False).startswith("yes"), what=lambda: f"{user}'s rights")


def test_a_tenant_sees_reasons_without_names_of_nodes_and_an_admin_sees_all(
    installed_plane: ControlPlane, stage: Stage, guarded: Process
) -> None:
    path = f"/explain/{stage.namespace}/asked"
    with nodes(installed_plane, edge("edge-1"), edge("edge-2")):
        for name in ("edge-1", "edge-2"):  # bound there: the scheduler knows both
            stage.create_pod(pod(f"on-{name}", nodeSelector={"kubernetes.io/hostname": name}))
            stage.wait_bound(f"on-{name}")
        created = datetime.now(UTC)
        stage.create_pod(pod("asked"))
        chosen = stage.wait_bound("asked")
        other = {"edge-1": "edge-2", "edge-2": "edge-1"}[chosen]
        assert get(guarded, path)[0] == 401
        assert get(guarded, path, bearer="made-up")[0] == 401
        assert get(guarded, path, bearer=token(installed_plane, "tenant-b"))[0] == 403
        allow(stage, "tenant")
        status, found = get(guarded, path, bearer=token(installed_plane, "tenant"))
        assert (status, found["node"], found["recomputed"]) == (200, chosen, False)
        assert other not in json.dumps(found)
        assert created <= datetime.fromisoformat(found["at"]) <= datetime.now(UTC)
        status, found = get(guarded, f"{path}?full=1", bearer=token(installed_plane, "admin"))
        assert (status, found["runnerUp"]) == (200, other)
        assert {chosen, other} <= set(found["full"]["table"]["nodes"])
        assert get(guarded, f"/explain/{stage.namespace}/nobody", bearer=token(installed_plane, "admin"))[0] == 404


def test_a_client_certificate_is_an_identity_too(
    installed_plane: ControlPlane, stage: Stage, guarded: Process, authority: Authority, tmp_path: Path
) -> None:
    def presenting(user: str) -> ssl.SSLContext:
        context = unverified()
        context.load_cert_chain(*authority.user(tmp_path / user, user, "tenants"))
        return context

    with nodes(installed_plane, edge("edge-1")):
        stage.create_pod(pod("asked"))
        stage.wait_bound("asked")
        path = f"/explain/{stage.namespace}/asked"
        allow(stage, "amy")
        assert get(guarded, path, context=presenting("amy"))[0] == 200
        assert get(guarded, path, context=presenting("ben"))[0] == 403


def test_after_a_restart_the_explanation_is_made_again_and_says_so(
    installed_plane: ControlPlane, stage: Stage, guarded: Process
) -> None:
    with nodes(installed_plane, edge("edge-1")):
        stage.create_pod(pod("old"))
        stage.wait_bound("old")
        guarded.stop()
        guarded.start().wait_ready()
        status, found = get(guarded, f"/explain/{stage.namespace}/old", bearer=token(installed_plane, "admin"))
        assert (status, found["recomputed"], found["node"]) == (200, True, "edge-1")


def test_the_configuration_is_for_who_may_get_the_path(installed_plane: ControlPlane, guarded: Process) -> None:
    status, found = get(guarded, "/configz", bearer=token(installed_plane, "admin"))
    assert status == 200
    assert len(found["kubescheduler.config.k8s.io"]["profiles"]) == 2
    assert get(guarded, "/configz", bearer=token(installed_plane, "tenant"))[0] == 403


# --- Metrics ---------------------------------------------------------------------------------------------------------

RBAC = "/apis/rbac.authorization.k8s.io/v1"
READER = "robotapp-metrics-reader"
"""The chart's role for who scrapes."""


def scrape(scheduler: Process, bearer: str = "") -> tuple[int, str]:
    return ask(f"{scheduler.health_url}/metrics", bearer=bearer)


def test_metrics_are_for_who_may_get_them_and_health_is_for_everybody(
    installed_plane: ControlPlane, stage: Stage, guarded: Process
) -> None:
    cp, name = installed_plane, f"scraper-{stage.namespace}"
    assert scrape(guarded)[0] == 401
    assert scrape(guarded, "made-up")[0] == 401
    status, text = scrape(guarded, token(cp, "tenant"))
    assert (status, "scheduler_" in text) == (403, False)
    for path in ("/livez", "/healthz", "/readyz"):
        assert ask(f"{guarded.health_url}{path}")[0] == 200
    account = f"/api/v1/namespaces/{stage.namespace}/serviceaccounts"
    cp.api.create(account, {"metadata": {"name": name}})
    group = "rbac.authorization.k8s.io"
    binding = {
        "metadata": {"name": name},
        "roleRef": {"apiGroup": group, "kind": "ClusterRole", "name": READER},
        "subjects": [{"kind": "ServiceAccount", "name": name, "namespace": stage.namespace}],
    }
    cp.api.create(f"{RBAC}/clusterrolebindings", binding)
    try:
        issued = cp.api.create(f"{account}/{name}/token", {"spec": {"expirationSeconds": 600}})["status"]["token"]
        with nodes(cp, edge("edge-1")):
            stage.create_pod(pod("counted"))
            stage.wait_bound("counted")
        stage.wait(lambda: 'extension_point="Bind",profile="ros-aware' in scrape(guarded, issued)[1], what=str)
        status, text = scrape(guarded, issued)
        assert status == 200
        assert "# TYPE scheduler_schedule_attempts_total counter" in text
        assert get(guarded, "/configz", bearer=issued)[0] == 403
    finally:
        cp.api.delete(f"{RBAC}/clusterrolebindings/{name}")
