from pathlib import Path

import pytest

from robotapp_testbed import TestbedError
from robotapp_testbed.real.box import Box, Plan


def test_a_plan_names_layers_and_pretended_settings_below_its_folder() -> None:
    plan = Plan(
        hostname="edge-1",
        overlays=("/var/lib",),
        binds=((Path("/run/x/kubelet"), "/var/lib/kubelet"),),
        sysctls={"net/ipv4/ip_forward": "1"},
        pretended=("kernel/panic",),
    )
    document = plan.document(Path("/f"))
    assert document["mounts"] == [
        {
            "kind": "overlay",
            "source": "/var/lib",
            "target": "/var/lib",
            "upper": "/f/upper/var-lib",
            "work": "/f/work/var-lib",
        },
        {"kind": "bind", "source": "/run/x/kubelet", "target": "/var/lib/kubelet"},
    ]
    assert document["pretended"] == {"kernel/panic": "/f/sysctls/kernel.panic"}
    assert document["sysctls"] == {"net/ipv4/ip_forward": "1"}


def test_a_box_that_does_not_run_has_no_pid(tmp_path: Path) -> None:
    box = Box("edge-1", Plan(hostname="edge-1"), folder=tmp_path, run_dir=tmp_path, logs_dir=tmp_path)
    assert not box.running
    with pytest.raises(TestbedError, match="edge-1 is not running"):
        _ = box.netns
