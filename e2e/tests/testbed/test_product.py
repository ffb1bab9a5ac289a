"""What of the chart is applied and in which order, with helm and kubectl replaced by recorders."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import pytest
import yaml

from robotapp_testbed import ApiStatusError, ControlPlane, TestbedError
from robotapp_testbed.control_plane import product
from robotapp_testbed.failures import CommandError

CRD = "CustomResourceDefinition"


def obj(kind: str, name: str, **annotations: str) -> dict[str, Any]:
    return {"apiVersion": "v1", "kind": kind, "metadata": {"name": name, "annotations": annotations}}


class Plane:
    """Records what is applied; `denial` is the API server's answer to what is forged."""

    def __init__(self, rendered: list[dict[str, Any]]) -> None:
        self.rendered = rendered
        self.applied: list[list[str]] = []
        self.waited: list[str] = []
        self.values: Any = None
        self.denials: list[str] = ["forbidden: ValidatingAdmissionPolicy 'grants' denied request: is a grant"]
        self.probed: list[str] = []
        self.logs_dir = Path("/logs")
        self.present: list[str] = []
        self.learned = 0
        self.wait_errors: list[str] = []
        self.unlisted_for = 0

    @property
    def api(self) -> "Plane":
        return self

    def get(self, path: str) -> dict[str, Any]:
        assert path.endswith("/customresourcedefinitions")
        return {"items": [{"metadata": {"name": name}} for name in self.present]}

    def learn_new_kinds(self) -> None:
        self.learned += 1

    def helm(self, *args: str, stdin: str) -> str:
        assert args[0] == "template"
        self.values = yaml.safe_load(stdin)
        return yaml.safe_dump_all([*self.rendered, None])

    def kubectl(self, *args: str, stdin: list[Mapping[str, Any]] | None = None) -> str:
        if args[0] == "apply":
            self.applied.append(
                [f"{each['kind']}/{each['metadata']['name']}" for each in json.loads(json.dumps(stdin))]
            )
        elif args[0] == "api-resources":
            self.unlisted_for -= 1
            return "" if self.unlisted_for >= 0 else "\n".join(self.waited[1:])
        else:
            if self.wait_errors:
                raise CommandError(["kubectl", *args], 1, "", self.wait_errors.pop(0))
            self.waited = [arg for arg in args[1:] if not arg.startswith("--")]
        return ""

    def create(self, path: str, body: Mapping[str, Any]) -> None:
        del body
        self.probed.append(path.removesuffix("?dryRun=All").rpartition("/")[2])
        assert path.endswith("?dryRun=All"), "nothing is really created"
        if len(self.probed) >= len(self.denials) and self.denials:
            raise ApiStatusError("POST", path, 422, self.denials[-1])


def installed(rendered: list[dict[str, Any]], **values: Any) -> Plane:
    plane = Plane(rendered)
    product.install(cast(ControlPlane, plane), values=values)
    return plane


@pytest.fixture(autouse=True)
def _crds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "robotapps.yaml").write_text(yaml.safe_dump(obj(CRD, "robotapps.robotics.io")))
    (tmp_path / "notes.txt").write_text("not a manifest")
    monkeypatch.setattr(product, "CRDS", tmp_path)


def test_definitions_are_established_before_what_needs_them() -> None:
    plane = installed([obj("ClusterRole", "r"), obj("DomainPool", "default"), obj(CRD, "domainpools.robotics.io")])
    first, second = plane.applied
    assert first[0] == "Namespace/robotapp-system"
    assert set(first[1:]) == {f"{CRD}/robotapps.robotics.io", f"{CRD}/domainpools.robotics.io"}
    assert set(plane.waited) == {"crd", "robotapps.robotics.io", "domainpools.robotics.io"}
    assert second == ["ClusterRole/r", "DomainPool/default"]


def test_definitions_are_listed_by_discovery_before_anything_else_is_applied() -> None:
    plane = Plane([obj("DomainPool", "default")])
    plane.unlisted_for = 2
    product.install(cast(ControlPlane, plane))
    assert plane.unlisted_for == -1


def test_definitions_that_discovery_never_lists_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(product, "_ESTABLISHED_S", 0.1)
    plane = Plane([obj("DomainPool", "default")])
    plane.unlisted_for = 1_000
    with pytest.raises(TestbedError, match="lists no robotapps"):
        product.install(cast(ControlPlane, plane))


def test_a_definition_of_the_chart_is_not_applied_a_second_time_from_its_file() -> None:
    plane = installed([obj(CRD, "robotapps.robotics.io")])
    assert plane.applied[0].count(f"{CRD}/robotapps.robotics.io") == 1


@pytest.mark.parametrize("kind", ["Deployment", "DaemonSet", "Job", "PodDisruptionBudget"])
def test_workloads_are_left_to_local_processes(kind: str) -> None:
    assert installed([obj(kind, "operator"), obj("ClusterRole", "r")]).applied[1] == ["ClusterRole/r"]


@pytest.mark.parametrize(
    ("hook", "kept"),
    [("post-install,post-upgrade", True), ("pre-install", True), ("pre-delete", False), ("test", False)],
)
def test_hooks_of_an_installation_belong_to_it(hook: str, kept: bool) -> None:
    plane = installed([obj("DomainPool", "default", **{"helm.sh/hook": hook}), obj("ClusterRole", "r")])
    assert ("DomainPool/default" in plane.applied[1]) is kept


def test_values_reach_the_chart() -> None:
    assert installed([], domainPool={"quarantineSeconds": 1}).values == {"domainPool": {"quarantineSeconds": 1}}


def test_a_tree_without_a_chart_gets_the_definitions_alone(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(product, "CHART", tmp_path / "none")
    assert installed([obj("ClusterRole", "r")]).applied == [
        ["Namespace/robotapp-system", f"{CRD}/robotapps.robotics.io"]
    ]


def test_install_returns_when_all_policies_decide() -> None:
    plane = Plane([obj("ValidatingAdmissionPolicyBinding", "grants")])
    plane.denials = ["", "", plane.denials[0]]
    product.install(cast(ControlPlane, plane))
    assert plane.probed == ["pods", "pods", "pods", "robotappinstances"]


def test_without_policies_nothing_is_probed() -> None:
    assert installed([obj("ClusterRole", "r")]).probed == []


def test_policies_that_never_decide_are_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(product, "_POLICIES_S", 0.1)
    plane = Plane([obj("ValidatingAdmissionPolicyBinding", "grants")])
    plane.denials = ["forbidden for another reason"]
    with pytest.raises(TestbedError, match="stored but do not decide"):
        product.install(cast(ControlPlane, plane))


@pytest.mark.parametrize(("present", "times"), [([], 1), (["robotapps.robotics.io"], 0)])
def test_the_garbage_collector_is_told_of_kinds_it_does_not_know(present: list[str], times: int) -> None:
    plane = Plane([])
    plane.present = present
    product.install(cast(ControlPlane, plane))
    assert plane.learned == times


def test_a_definition_without_a_status_yet_is_waited_for() -> None:
    plane = Plane([])
    plane.wait_errors = ["error: .status.conditions accessor error: <nil> is of the type <nil>"] * 2
    product.install(cast(ControlPlane, plane))
    assert plane.waited == ["crd", "robotapps.robotics.io"]


def test_other_failures_of_the_wait_are_reported() -> None:
    plane = Plane([])
    plane.wait_errors = ["error: timed out waiting for the condition"]
    with pytest.raises(CommandError, match="timed out"):
        product.install(cast(ControlPlane, plane))
