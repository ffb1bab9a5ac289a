"""Files users carry over: kube-scheduler itself says which of them are right, what they mean, and our reader agrees.

The cases that need no cluster are in tests/unit/shell.
"""

import json
import os
import random
import re
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml
from tests.support.wrong_input.configurations import ACCEPTED, OURS_ALONE, REFUSED, config

from robotapp_scheduler.config.load import parse_text
from robotapp_scheduler.core.framework.profiles import POINTS
from robotapp_scheduler.plugins.registry import ROS, UPSTREAM_POINTS, catalogue
from robotapp_testbed.binaries.assets import Assets

pytestmark = pytest.mark.live

KUBECONFIG = {
    "apiVersion": "v1",
    "kind": "Config",
    "clusters": [{"name": "nowhere", "cluster": {"server": "http://127.0.0.1:1"}}],
    "contexts": [{"name": "nowhere", "context": {"cluster": "nowhere", "user": "nobody"}}],
    "users": [{"name": "nobody", "user": {}}],
    "current-context": "nowhere",
}
BOTH = ["TaintToleration", "NodeAffinity", "NodeResourcesFit", "VolumeBinding", "PodTopologySpread", "InterPodAffinity"]
NAMES = {
    "score": [*BOTH, "NodeResourcesBalancedAllocation", "ImageLocality"],
    "filter": [*BOTH, "NodeName", "NodePorts", "VolumeZone", "NodeUnschedulable", "NodeDeclaredFeatures"],
}
NAMES["multiPoint"] = sorted({name for names in NAMES.values() for name in names})
OURS = {ref.name for ref in ROS}


def command(folder: Path, fields: dict[str, Any]) -> list[str]:
    """kube-scheduler with this file; nobody answers it."""
    kubeconfig, given = folder / "kubeconfig", folder / "given.yaml"
    kubeconfig.write_text(yaml.safe_dump(KUBECONFIG))
    head = {"apiVersion": "kubescheduler.config.k8s.io/v1", "kind": "KubeSchedulerConfiguration"}
    client = {"kubeconfig": str(kubeconfig), **(fields.get("clientConnection") or {})}
    given.write_text(yaml.safe_dump(head | fields | {"clientConnection": client}))
    binary = Assets().resolve(["kube-scheduler"])["kube-scheduler"]
    return [str(binary), f"--config={given}", "--secure-port=0", "--authentication-skip-lookup"]


def judged(folder: Path, fields: dict[str, Any]) -> subprocess.CompletedProcess[str]:
    """kube-scheduler reads the file, writes what it understood, and ends."""
    argv = [*command(folder, fields), f"--write-config-to={folder / 'understood.yaml'}"]
    return subprocess.run(argv, capture_output=True, text=True, timeout=60, check=False)


def understood(folder: Path, plugins: dict[str, Any]) -> dict[str, Any] | None:
    """The plugins of each point as kube-scheduler starts with them; None where it refuses."""
    fields = {"leaderElection": {"leaderElect": False}, "profiles": [{"schedulerName": "mine", "plugins": plugins}]}
    argv = [*command(folder, fields), "-v=2", "--log-flush-frequency=50ms"]
    with subprocess.Popen(argv, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        for line in process.stderr:
            started = re.search(r'"the scheduler starts to work with those plugins" Plugins=(\{.*\})', line)
            if started or "command failed" in line:
                break
        process.kill()
    return json.loads(started.group(1)) if started else None


def drawn(rng: random.Random) -> dict[str, Any]:
    """Plugin lists as nobody would write them."""
    found: dict[str, Any] = {}
    for point, names in NAMES.items():
        if rng.random() < 0.6:
            enabled = [{"name": name, "weight": rng.choice([0, 1, 5])} for name in rng.sample(names, rng.randint(0, 3))]
            disabled = [{"name": name} for name in rng.sample(names, rng.randint(0, 3))]
            found[point] = {"enabled": enabled, "disabled": disabled + [{"name": "*"}] * (rng.random() < 0.2)}
    if {"name": "*"} in found.get("multiPoint", {}).get("disabled", []):
        found["multiPoint"]["enabled"] += [{"name": "PrioritySort"}, {"name": "DefaultBinder"}]
    return found


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


@pytest.mark.parametrize("draw", range(12))
def test_profiles_have_kube_schedulers_plugins_in_its_order_with_its_weights(draw: int, tmp_path: Path) -> None:
    seed = f"{os.environ.get('ROBOTAPP_SEED') or random.randrange(1 << 30)}/{draw}"
    plugins = drawn(random.Random(seed))
    theirs = understood(tmp_path, plugins)
    assert theirs is not None, (seed, plugins)
    mine = config(catalogue(), profiles=[{"schedulerName": "mine", "plugins": plugins}]).build()["mine"]
    for point, chain in (("Filter", mine.filters), ("Score", mine.scores)):
        expected = [(each["Name"], each["Weight"]) for each in theirs[point]["Enabled"] or ()]
        found = [(each.name, each.weight if point == "Score" else 0) for each in chain if each.name not in OURS]
        # Devices of claims are not allocated here, so there is nothing to score.
        assert [each for each in found if each[0] != "DynamicResources"] == [
            (name, weight if point == "Score" else 0) for name, weight in expected if name != "DynamicResources"
        ], (seed, plugins)


def test_the_whole_configuration_kube_scheduler_writes_out_is_taken(tmp_path: Path) -> None:
    found = judged(tmp_path, {})
    assert found.returncode == 0, found.stderr[-2000:]
    written = parse_text((tmp_path / "understood.yaml").read_text(), catalogue=catalogue())
    (name,) = written.scheduler_names
    assert name == "default-scheduler"
    assert written.build()[name].queue_sort.name == "PrioritySort"


def test_the_points_of_its_plugins_are_those_we_know(tmp_path: Path) -> None:
    theirs = understood(tmp_path, {})
    assert theirs is not None
    found: dict[str, set[str]] = {}
    for point, plugins in theirs.items():
        for each in plugins["Enabled"] or () if point[0].lower() + point[1:] in POINTS else ():
            found.setdefault(each["Name"], set()).add(point[0].lower() + point[1:])
    known = {name: set(points.split()) for name, points in UPSTREAM_POINTS.items()}
    assert {name: points for name, points in found.items() if name in known} == known
    assert all(len(points) == 1 for name, points in found.items() if name not in known)
