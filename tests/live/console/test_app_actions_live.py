"""What a tenant does with its app from the console's page, and what a viewer cannot do."""

import re
from html import unescape
from pathlib import Path

import pytest
from tests.live.console.browsing import Console, make_token

from robotapp_api.values.naming import child_name
from robotapp_client.tools.rollout import RESTARTED_AT
from robotapp_testbed import ControlPlane, wait_until

pytestmark = pytest.mark.live
MINIMAL = Path(__file__).resolve().parents[3] / "examples" / "minimal.yaml"
ACTIONS = ("suspend", "resume", "restart", "approve", "delete")


def find_button(page: str, action: str) -> str:
    """Returns where the button for this action leads, empty without one."""
    button = re.search(rf'<button form="actions" formaction="([^"?]*/{action}\?[^"]*)"', page)
    return unescape(button[1]) if button else ""


def press(console: Console, path: str, action: str) -> None:
    """Presses the button as soon as the page has it; the API server accepts what it does."""
    pages: list[str] = []

    def has_button() -> bool:
        pages.append(console.get(path)[1])
        return bool(find_button(pages[-1], action))

    assert wait_until(has_button, timeout_s=30, poll_s=0.3), f"no button for {action}"
    assert console.post(find_button(pages[-1], action), {"csrf": read_csrf(pages[-1])})[0] == 303


def read_csrf(page: str) -> str:
    csrf = re.search(r'name="csrf" value="([^"]+)"', page)
    assert csrf is not None
    return csrf[1]


@pytest.mark.usefixtures("fleet")
def test_a_tenant_restarts_suspends_resumes_and_deletes_its_app_and_a_viewer_cannot(
    installed_plane: ControlPlane, console: Console, namespace: str
) -> None:
    def read(kind: str, name: str, field: str) -> str:
        return installed_plane.kubectl("get", kind, name, "-n", namespace, "-o", f"jsonpath={{{field}}}").strip()

    installed_plane.kubectl("apply", "-n", namespace, "-f", str(MINIMAL))
    path, deployment = f"/apps/{namespace}/minimal", child_name("minimal", "", "talker")
    tenant, viewer = (make_token(installed_plane, namespace, role=role) for role in ("edit", "view"))
    assert console.sign_in(tenant, namespace) == 303
    press(console, path, "restart")
    annotation = ".spec.template.metadata.annotations." + RESTARTED_AT.replace(".", r"\.")
    restarted_at = read("deployment", deployment, annotation)
    assert restarted_at
    press(console, path, "suspend")
    assert read("ra", "minimal", ".spec.suspend") == "true"
    assert wait_until(lambda: read("deployment", deployment, ".spec.replicas") == "0", timeout_s=30)

    assert console.sign_in(viewer, namespace) == 303
    status, page = console.get(path)
    assert status == 200
    assert "talker" in page
    assert not any(f"{path}/{action}" in page for action in ACTIONS)
    uid = read("ra", "minimal", ".metadata.uid")
    for action in ACTIONS:
        forged = {"uid": uid, "component": "talker", "typed": "minimal", "version": "9", "csrf": read_csrf(page)}
        assert console.post(f"{path}/{action}", forged)[0] == 403
    assert read("ra", "minimal", ".spec.suspend") == "true"

    assert console.sign_in(tenant, namespace) == 303
    press(console, path, "resume")
    assert wait_until(lambda: read("deployment", deployment, ".spec.replicas") == "1", timeout_s=30)
    assert read("deployment", deployment, annotation) == restarted_at, "the operator leaves the restart as it is"
    _, form = console.get(f"{path}/delete")
    deletion = {"csrf": read_csrf(form), "uid": uid}
    assert console.post(f"{path}/delete", deletion | {"typed": "other"})[0] == 422
    assert console.post(f"{path}/delete", deletion | {"typed": "minimal"})[0] == 303
    left = ("get", "ra", "-n", namespace, "-o", "name")
    assert wait_until(lambda: not installed_plane.kubectl(*left).strip(), timeout_s=30)
