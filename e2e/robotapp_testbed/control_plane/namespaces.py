"""Namespaces for tests."""

from collections.abc import Iterator
from contextlib import contextmanager
from http import HTTPStatus

from robotapp_testbed.control_plane.controlplane import ControlPlane
from robotapp_testbed.failures import ApiStatusError, TestbedError
from robotapp_testbed.processes.process import wait_until

_READY_S = 60.0


@contextmanager
def created(cp: ControlPlane, name: str) -> Iterator[str]:
    """Create the namespace, wait until pods can be created in it, delete it at the end without waiting, unless it is gone already."""
    cp.api.create("/api/v1/namespaces", {"metadata": {"name": name}})
    try:
        if cp.has_controllers and not wait_until(lambda: _has_account(cp, name), timeout_s=_READY_S):
            raise TestbedError(f"namespace {name} got no default ServiceAccount in {_READY_S:.0f} s, see {cp.logs_dir}")
        yield name
    finally:
        try:
            cp.api.delete(f"/api/v1/namespaces/{name}")
        except ApiStatusError as error:
            if error.status != HTTPStatus.NOT_FOUND:
                raise


def _has_account(cp: ControlPlane, namespace: str) -> bool:
    try:
        cp.api.get(f"/api/v1/namespaces/{namespace}/serviceaccounts/default")
    except ApiStatusError as error:
        if error.status == 404:
            return False
        raise
    return True
