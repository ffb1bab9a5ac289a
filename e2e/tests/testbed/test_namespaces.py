from collections.abc import Mapping
from typing import Any, cast

import pytest

from robotapp_testbed import ApiStatusError, ControlPlane, TestbedError
from robotapp_testbed.control_plane import namespaces


class Plane:
    """Its default ServiceAccount appears at the third look."""

    def __init__(self, *, has_controllers: bool = True, status: int = 404) -> None:
        self.has_controllers = has_controllers
        self.status = status
        self.looks = 0
        self.calls: list[str] = []
        self.logs_dir = "/logs"

    @property
    def api(self) -> "Plane":
        return self

    def create(self, path: str, obj: Mapping[str, Any]) -> None:
        self.calls.append(f"create {path}/{obj['metadata']['name']}")

    def delete(self, path: str) -> None:
        self.calls.append(f"delete {path}")

    def get(self, path: str) -> None:
        self.looks += 1
        if self.looks < 3:
            raise ApiStatusError("GET", path, self.status, "no")


def use(plane: Plane) -> None:
    with namespaces.created(cast(ControlPlane, plane), "n") as name:
        assert name == "n"
        plane.calls.append("used")


def test_a_namespace_is_used_once_pods_can_be_created_in_it_and_then_deleted() -> None:
    plane = Plane()
    use(plane)
    assert plane.looks == 3
    assert plane.calls == ["create /api/v1/namespaces/n", "used", "delete /api/v1/namespaces/n"]


def test_without_controllers_nobody_makes_the_account_and_nobody_needs_it() -> None:
    plane = Plane(has_controllers=False)
    use(plane)
    assert plane.looks == 0


def test_it_is_deleted_when_the_test_fails() -> None:
    plane = Plane()
    with pytest.raises(AssertionError), namespaces.created(cast(ControlPlane, plane), "n"):
        raise AssertionError
    assert plane.calls[-1] == "delete /api/v1/namespaces/n"


def test_another_error_than_not_found_is_raised() -> None:
    with pytest.raises(ApiStatusError, match="403"):
        use(Plane(status=403))


def test_an_account_that_never_comes_is_explained(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(namespaces, "_READY_S", 0.0)
    with pytest.raises(TestbedError, match="no default ServiceAccount"):
        use(Plane())
