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


def test_another_platform_is_refused_with_what_to_use(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(platform, "system", lambda: "Darwin")
    with pytest.raises(TestbedError, match="use a Linux machine or container"):
        pins.platform_names()
