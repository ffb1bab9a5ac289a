"""Fixtures of the testbed: one control plane per test session, a namespace per test.

Loaded for every run, so it imports nothing heavy until a test asks for the control plane.
"""

import secrets
from collections.abc import Generator, Iterator
from typing import TYPE_CHECKING, Final

import pytest

if TYPE_CHECKING:
    from robotapp_testbed import ControlPlane
    from robotapp_testbed.real import RealNodes

_FIXTURES = {"control_plane", "installed_plane", "real_nodes"}
_RUNNING: list["ControlPlane"] = []
_FEWER_COLLECTIONS: Final = {"kube-apiserver": {"GOGC": "400"}}
"""The API server is what live tests wait for. With Go's default it spends a third of its CPU on writes in garbage collection."""


@pytest.fixture(scope="session")
def control_plane() -> Iterator["ControlPlane"]:
    """etcd, kube-apiserver, kube-controller-manager and kwok, with an audit log; nothing of the product."""
    from robotapp_testbed import ControlPlane

    with ControlPlane(audit=True, environment=_FEWER_COLLECTIONS) as plane:
        _RUNNING.append(plane)
        yield plane
        _RUNNING.remove(plane)


@pytest.fixture(scope="session")
def installed_plane(control_plane: "ControlPlane") -> "ControlPlane":
    """The same control plane with our CRDs, default pool, RBAC and policies; the programs are the test's to start."""
    from robotapp_testbed.control_plane import product

    product.install(control_plane, values={"agent": {"labeller": {"enabled": True}}})
    return control_plane


@pytest.fixture
def namespace(control_plane: "ControlPlane") -> Iterator[str]:
    """A fresh namespace that can run pods; deleted afterwards, without waiting for it."""
    from robotapp_testbed.control_plane.namespaces import created

    with created(control_plane, f"test-{secrets.token_hex(3)}") as name:
        yield name


@pytest.fixture(scope="session")
def real_machine() -> type["RealNodes"]:
    """What starts real nodes on this machine; a test is skipped with the sentence that says what is missing."""
    from robotapp_testbed.real import RealNodes, prerequisites

    problem = prerequisites.missing()
    if problem:
        pytest.skip(str(problem))
    return RealNodes


@pytest.fixture(scope="session")
def real_nodes(real_machine: type["RealNodes"]) -> Iterator["RealNodes"]:
    """Two real nodes, robot-1 and edge-1, joined by the latency switch; nothing of the product."""
    from robotapp_testbed.machines.nodes import edge, robot

    with real_machine([robot("robot-1"), edge("edge-1")], delays={}, images=("tools", "agent")) as plane:
        _RUNNING.append(plane)
        yield plane
        _RUNNING.remove(plane)


@pytest.fixture
def real_namespace(real_nodes: "RealNodes") -> Iterator[str]:
    """A fresh namespace for pods on the real nodes."""
    from robotapp_testbed.control_plane.namespaces import created

    with created(real_nodes, f"test-{secrets.token_hex(3)}") as name:
        yield name


def running_plane() -> "ControlPlane | None":
    """The session's control plane if a test has asked for it."""
    return _RUNNING[0] if _RUNNING else None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Whatever uses the control plane is a live test, said or not."""
    for item in items:
        if (_FIXTURES | {"real_machine"}) & set(getattr(item, "fixturenames", ())):
            item.add_marker(pytest.mark.live)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """A failed live test says where the programs' logs are, and they outlive the session."""
    report = yield
    if report.failed and _FIXTURES & set(getattr(item, "fixturenames", ())):
        for plane in _RUNNING:
            kept = plane.keep_logs()
            report.sections.append(("Logs of the control plane", f"{plane.logs_dir} now, {kept} after the session"))
    return report
