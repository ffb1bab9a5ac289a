"""A writer of RobotApps plants past specs, for the owner of an app to bring back with `rigel-bridge rollback`."""

import contextlib
import io
from collections.abc import Mapping
from typing import Any, Final

from campaigns.hostile.attack import Outcome, judge, register
from campaigns.hostile.intruder import Intruder, Json, intruding
from campaigns.rigs.simulated_site import SimulatedSite, plain_app
from rigel_bridge.main import main as rigel_bridge
from robotapp_api.model.names import API_VERSION, Label
from robotapp_testbed import wait_until
from robotapp_testbed.failures import ApiStatusError

REVISIONS: Final = "/apis/apps/v1/namespaces/{}/controllerrevisions"
POLICY_S: Final = 90.0
IMAGE: Final = "registry.example/stranger:1"
_TOKEN: Final = {"name": "token", "projected": {"sources": [{"serviceAccountToken": {"path": "token"}}]}}
_SECRET: Final = {"name": "KEY", "valueFrom": {"secretKeyRef": {"name": "deploy-key", "key": "key"}}}
LENDING: Final[Mapping[str, Json]] = {
    "an account": {"template": {"spec": {"serviceAccountName": "deployer"}}},
    "a Secret": {"env": [_SECRET]},
    "a token": {"template": {"spec": {"volumes": [_TOKEN]}}},
    "a priority": {"template": {"spec": {"priorityClassName": "system-node-critical"}}},
}
"""What a component of a planted spec names that its writer may not lend."""


@register(
    "planted-revisions",
    "past specs with another's image, account, Secret, token and priority, and the owner's rollback",
)
def plant_revisions(site: SimulatedSite) -> Outcome:
    with intruding(site, "editor") as intruder:
        app = intruder.create(plain_app("teleop", parts=("driver",), suspend=True))
        _await_policy(intruder, app)
        lending_specs = [what for what, fields in LENDING.items() if plant(intruder, app, 2, fields) is None]
        texts = [text for fields in LENDING.values() if (text := plant(intruder, app, 2, fields)) is not None]
        image_refusal = plant(intruder, app, 3, {"image": IMAGE})
        output = roll_back(site, intruder.namespace)
        stored = intruder.app("teleop")
    figures = {
        "planted specs that lend": float(len(lending_specs)),
        "refusals without a cure": float(sum("the right to create pods" not in text for text in texts)),
        "specs with another image refused": float(image_refusal is not None),
        "rollbacks to it unasked": float(stored["spec"] != app["spec"]),
        "rollbacks without the difference": float(IMAGE not in output or "repeat with --yes" not in output),
    }
    return judge(figures, dict.fromkeys(figures, 0))


def plant(intruder: Intruder, app: Json, number: int, fields: Mapping[str, Any], *, query: str = "") -> str | None:
    """Writes a past spec of the app whose component has these fields. Returns the refusal, or None when it is stored."""
    metadata = app["metadata"]
    spec = {**app["spec"], "components": [{**app["spec"]["components"][0], **fields}]}
    owner = {"apiVersion": API_VERSION, "kind": "RobotApp", "name": metadata["name"], "uid": metadata["uid"]}
    body = {
        "metadata": {
            "name": f"{metadata['name']}-{number}",
            "labels": {Label.APP.value: metadata["name"], Label.APP_UID.value: metadata["uid"]},
            "ownerReferences": [{**owner, "controller": True}],
        },
        "revision": number,
        "data": {"spec": spec},
    }
    try:
        intruder.api.create(f"{REVISIONS.format(intruder.namespace)}{query}", body)
    except ApiStatusError as error:
        return error.message
    return None


def _await_policy(intruder: Intruder, app: Json) -> None:
    """A policy decides about a second after it was stored."""

    def decides() -> bool:
        return plant(intruder, app, 9, LENDING["an account"], query="?dryRun=All") is not None

    if not wait_until(decides, timeout_s=POLICY_S):
        raise AssertionError(f"a past spec with an account was not refused within {POLICY_S:.0f} s")


def roll_back(site: SimulatedSite, namespace: str) -> str:
    """Returns what `rigel-bridge rollback` prints for the cluster's admin, who is not asked because nobody is at a terminal."""
    cluster = [f"--kubeconfig={site.cp.kubeconfig('admin')}", f"--kubectl={site.cp.bin_dir / 'kubectl'}"]
    output = io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(output):
        rigel_bridge(["rollback", "teleop", "-n", namespace, *cluster])
    return output.getvalue()
