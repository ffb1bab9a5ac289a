"""Files users carry over: kube-scheduler itself says which of them are right, and our reader agrees (tests/unit/shell)."""

import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml
from tests.support.configurations import ACCEPTED, OURS_ALONE, REFUSED

from robotapp_testbed.assets import Assets

pytestmark = pytest.mark.live

KUBECONFIG = {
    "apiVersion": "v1",
    "kind": "Config",
    "clusters": [{"name": "nowhere", "cluster": {"server": "http://127.0.0.1:1"}}],
    "contexts": [{"name": "nowhere", "context": {"cluster": "nowhere", "user": "nobody"}}],
    "users": [{"name": "nobody", "user": {}}],
    "current-context": "nowhere",
}


def judged(folder: Path, fields: dict[str, Any]) -> subprocess.CompletedProcess[str]:
    """kube-scheduler reads the file, writes what it understood, and ends."""
    kubeconfig, given = folder / "kubeconfig", folder / "given.yaml"
    kubeconfig.write_text(yaml.safe_dump(KUBECONFIG))
    head = {"apiVersion": "kubescheduler.config.k8s.io/v1", "kind": "KubeSchedulerConfiguration"}
    client = {"kubeconfig": str(kubeconfig), **(fields.get("clientConnection") or {})}
    given.write_text(yaml.safe_dump(head | fields | {"clientConnection": client}))
    argv = [str(Assets().resolve(["kube-scheduler"])["kube-scheduler"]), f"--config={given}", "--secure-port=0",
            "--authentication-skip-lookup", f"--write-config-to={folder / 'understood.yaml'}"]  # fmt: skip
    return subprocess.run(argv, capture_output=True, text=True, timeout=60, check=False)


@pytest.mark.parametrize("what", [*ACCEPTED, *OURS_ALONE])
def test_kube_scheduler_accepts(what: str, tmp_path: Path) -> None:
    fields = ACCEPTED[what] if what in ACCEPTED else OURS_ALONE[what][0]
    found = judged(tmp_path, fields)
    assert found.returncode == 0, found.stderr[-2000:]


@pytest.mark.parametrize("what", REFUSED)
def test_kube_scheduler_refuses_with_the_same_words(what: str, tmp_path: Path) -> None:
    fields, text = REFUSED[what]
    found = judged(tmp_path, fields)
    assert found.returncode != 0
    assert text in found.stderr.replace('\\"', '"')
