"""A namespace that is being deleted while its RobotApps are still there: the operator makes nothing there, and does not try again and again."""

import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from campaigns.rigs.live import HandBinder, Tenant, eventually, part
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.failures import ApiStatusError
from robotapp_testbed.processes.process import Process

POLICIES = "/apis/admissionregistration.k8s.io/v1/validatingadmissionpolicies"
BINDINGS = "/apis/admissionregistration.k8s.io/v1/validatingadmissionpolicybindings"
NAMESPACE = "/api/v1/namespaces/{}"
APPS = 6
ROUNDS = 3
"""Edits that the operator would have to follow, had the namespace a future."""


@contextmanager
def kept_apps(cp: ControlPlane, namespace: str) -> Iterator[None]:
    """Nobody can delete the namespace's RobotApps: its deletion goes on with everything else and waits for them."""
    name = f"keep-{namespace}"
    rule = {"apiGroups": ["robotics.io"], "apiVersions": ["*"], "resources": ["robotapps"], "operations": ["DELETE"]}
    selector = {"matchLabels": {"kubernetes.io/metadata.name": namespace}}
    spec = {
        "matchConstraints": {"resourceRules": [rule], "namespaceSelector": selector},
        "validations": [{"expression": "false", "message": "kept by a test"}],
    }
    cp.api.create(POLICIES, {"metadata": {"name": name}, "spec": spec})
    cp.api.create(BINDINGS, {"metadata": {"name": name}, "spec": {"policyName": name, "validationActions": ["Deny"]}})
    try:
        yield
    finally:
        cp.api.delete(f"{BINDINGS}/{name}")
        cp.api.delete(f"{POLICIES}/{name}")


def is_refused(act: Callable[[], Any], text: str) -> bool:
    try:
        act()
    except ApiStatusError as error:
        return text in str(error)
    return False


def is_gone(cp: ControlPlane, namespace: str) -> bool:
    try:
        cp.api.get(NAMESPACE.format(namespace))
    except ApiStatusError as error:
        return error.status == 404
    return False


def test_in_a_namespace_that_is_being_deleted_nothing_is_tried_again_and_its_successor_is_served(
    installed_plane: ControlPlane, operator: Process
) -> None:
    cp, name = installed_plane, f"ending-{secrets.token_hex(3)}"
    with created(cp, name), HandBinder(cp, name), kept_apps(cp, name):
        tenant = Tenant(cp, name)
        tenant.apply("probe", part("a"), suspend=True)
        eventually(lambda: is_refused(lambda: tenant.delete("probe?dryRun=All"), "kept by a test"))
        for number in range(APPS):
            tenant.apply(f"app-{number}", part("a"), part("b"))
        for number in range(APPS):
            tenant.wait_ready(f"app-{number}")
        start = len(operator.log_text())

        cp.api.delete(NAMESPACE.format(name))
        eventually(lambda: not tenant.deployments() and not tenant.listed("pods"))
        for step in range(ROUNDS):
            for number in range(APPS):
                tenant.edit(f"app-{number}", components=[part("a"), part("b"), part(f"c{step}")])
                tenant.wait(f"app-{number}", "Ready", "False")
    eventually(lambda: is_gone(cp, name))
    lines = [line for line in operator.log_text()[start:].splitlines() if "being terminated" in line]
    assert len(lines) == 1, "\n".join(lines)
    assert f"namespace {name} is being deleted" in lines[0]
    assert operator.running

    with created(cp, name), HandBinder(cp, name):
        later = Tenant(cp, name)
        later.apply("app-0", part("a"))
        later.wait_ready("app-0")
