import platform
import re

import pytest

from robotapp_testbed import TestbedError
from robotapp_testbed.binaries import pins

GO_MOD = (pins.MODULE_DIR / "go.mod").read_text()


@pytest.mark.parametrize(
    ("module", "version"),
    [
        ("k8s.io/kubernetes", pins.KUBERNETES),
        ("go.etcd.io/etcd/server/v3", pins.ETCD),
        ("sigs.k8s.io/kwok", pins.KWOK),
        ("helm.sh/helm/v4", pins.HELM),
    ],
)
def test_releases_and_go_modules_are_pinned_to_the_same_version(module: str, version: str) -> None:
    assert re.search(rf"^\t{re.escape(module)} {re.escape(version)}( |$)", GO_MOD, re.MULTILINE)


@pytest.mark.parametrize("binary", pins.BINARIES, ids=lambda binary: binary.name)
def test_every_binary_is_a_tool_of_the_module(binary: pins.Binary) -> None:
    assert f"\t{binary.package}\n" in GO_MOD[GO_MOD.index("tool (") :]


def test_the_build_stamps_the_version_kubernetes_reports() -> None:
    _, minor, _ = pins.KUBERNETES.removeprefix("v").split(".")
    assert f"version.gitVersion={pins.KUBERNETES} " in pins.LDFLAGS
    assert pins.LDFLAGS.endswith(f"gitMinor={minor}")


def test_the_minimum_go_is_the_one_the_module_asks_for() -> None:
    assert re.search(rf"^go {pins.GO_MINIMUM[0]}\.{pins.GO_MINIMUM[1]}", GO_MOD, re.MULTILINE)
    assert pins.GO_WHEEL.startswith(f"{pins.GO_MINIMUM[0]}.{pins.GO_MINIMUM[1]}.")


def test_an_unknown_binary_is_answered_with_the_known_ones() -> None:
    with pytest.raises(TestbedError, match="known are etcd, kube-apiserver"):
        pins.binary("minikube")


@pytest.mark.parametrize(("machine", "arch"), [("x86_64", "amd64"), ("aarch64", "arm64")])
def test_the_platform_is_named_in_gos_words(machine: str, arch: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(platform, "machine", lambda: machine)
    assert pins.platform_names() == {"os": "linux", "arch": arch}


def test_another_platform_is_refused_with_what_to_use(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(platform, "system", lambda: "Darwin")
    with pytest.raises(TestbedError, match="use a Linux machine or container"):
        pins.platform_names()
