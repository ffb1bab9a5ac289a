"""Bindings that the API server refuses: an admission policy for namespaces with a label."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

from campaigns.scenarios.cluster import Json
from robotapp_testbed import ControlPlane, wait_until
from robotapp_testbed.failures import ApiStatusError

NAME: Final = "scenarios-refuse-bindings"
LABEL: Final = "scenarios.test/refuse-bindings"
MESSAGE: Final = "bindings are refused for a scenario"
DECIDES_S: Final = 60.0
_ROOT: Final = "/apis/admissionregistration.k8s.io/v1"
_POLICIES: Final = (f"{_ROOT}/validatingadmissionpolicies", f"{_ROOT}/validatingadmissionpolicybindings")


@contextmanager
def policy(cp: ControlPlane) -> Iterator[None]:
    """The policy exists while this lasts, and is of no effect but in namespaces with the label."""
    rule = {"apiGroups": [""], "apiVersions": ["v1"], "operations": ["CREATE"], "resources": ["pods/binding"]}
    where = {"namespaceSelector": {"matchLabels": {LABEL: "true"}}, "resourceRules": [rule]}
    specs: tuple[Json, Json] = (
        {"matchConstraints": where, "validations": [{"expression": "false", "message": MESSAGE}]},
        {"policyName": NAME, "validationActions": ["Deny"]},
    )
    for path, spec in zip(_POLICIES, specs, strict=True):
        cp.api.create(path, {"metadata": {"name": NAME}, "spec": spec})
    try:
        yield
    finally:
        for path in _POLICIES:
            cp.api.delete(f"{path}/{NAME}")


@contextmanager
def refused(cp: ControlPlane, namespace: str) -> Iterator[None]:
    """No pod of the namespace can be bound while this lasts. The server notices labels and policies a little later."""
    _label(cp, namespace, value="true")
    try:
        yield
    finally:
        _label(cp, namespace, value=None)


def _label(cp: ControlPlane, namespace: str, *, value: str | None) -> None:
    cp.api.patch(f"/api/v1/namespaces/{namespace}", {"metadata": {"labels": {LABEL: value}}})
    wanted = value is not None
    if not wait_until(lambda: _refuses(cp, namespace) is wanted, timeout_s=DECIDES_S, poll_s=0.05):
        raise TimeoutError(f"bindings in {namespace} are not {'refused' if wanted else 'allowed'} in {DECIDES_S:.0f} s")


def _refuses(cp: ControlPlane, namespace: str) -> bool:
    """Whether a binding is refused by the policy: nothing is stored, and no pod has this name."""
    target = {"apiVersion": "v1", "kind": "Node", "name": "nowhere"}
    body = {"apiVersion": "v1", "kind": "Binding", "metadata": {"name": "nobody"}, "target": target}
    try:
        cp.api.create(f"/api/v1/namespaces/{namespace}/pods/nobody/binding?dryRun=All", body)
    except ApiStatusError as error:
        return MESSAGE in error.message
    return False
