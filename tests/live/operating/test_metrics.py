"""The operator's port as users of the cluster meet it."""

from campaigns.rigs.ports import ask, token
from robotapp_testbed import ControlPlane
from robotapp_testbed.processes.process import Process


def test_metrics_are_for_who_may_get_them_and_health_is_for_everybody(
    installed_plane: ControlPlane, operator: Process
) -> None:
    url = str(operator.health_url)
    assert ask(f"{url}/metrics")[0] == 401
    assert ask(f"{url}/metrics", bearer="made-up")[0] == 401
    status, text = ask(f"{url}/metrics", bearer=token(installed_plane, "tenant"))
    assert (status, "workqueue_depth" in text) == (403, False)
    status, text = ask(f"{url}/metrics", bearer=token(installed_plane, "admin"))
    assert (status, "workqueue_depth" in text) == (200, True)
    for path in ("/healthz", "/readyz"):
        assert ask(f"{url}{path}")[0] == 200
