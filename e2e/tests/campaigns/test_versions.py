"""`scripts/bench versions`: what is run exists, and the result is told with its failures."""

from pathlib import Path
from typing import Any

import pytest

from campaigns.versions.cel import RELEASES
from campaigns.versions.versions import SMOKE, told
from robotapp_testbed import TestbedError
from robotapp_testbed.binaries import pins, versions

RESULT: dict[str, Any] = {"version": "v1.35.4", "demo": True, "demo_s": 50.2, "passed": 9, "bad": [], "smoke_s": 99.9}


@pytest.mark.parametrize("file", SMOKE)
def test_every_file_of_the_smoke_suite_exists(file: str) -> None:
    assert (pins.REPOSITORY / file).is_file()


def test_a_result_is_told_in_one_sentence_with_the_names_of_what_failed() -> None:
    assert told(RESULT) == "Kubernetes v1.35.4: the demo passed in 50 s, 9 smoke tests passed and 0 failed in 100 s"
    worse = told(RESULT | {"demo": False, "bad": ["tests/a.py::test_b"]})
    assert "THE DEMO FAILED" in worse
    assert worse.endswith("1 failed in 100 s: tests/a.py::test_b")


@pytest.mark.parametrize("minor", versions.OTHERS)
def test_each_other_version_has_a_module_that_pins_it_and_its_programs(minor: str) -> None:
    text = (versions.module_dir(minor) / "go.mod").read_text()
    version = versions.OTHERS[minor]
    assert version.startswith(f"v{minor}.")
    assert f"\tk8s.io/kubernetes {version} " in text
    assert f"k8s.io/apiserver => k8s.io/apiserver v0{version.removeprefix('v1')}" in text
    for program in versions.PROGRAMS:
        assert f"\t{pins.binary(program).package}\n" in text[text.index("tool (") :]
    assert minor in RELEASES


def test_a_version_nobody_compiles_is_answered_with_those_that_are() -> None:
    with pytest.raises(TestbedError, match=r"which are 1\.35, 1\.36"):
        versions.module_dir("1.20")


def test_programs_of_a_version_report_it_and_are_kept_apart_from_the_testbeds_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    go = tmp_path / "bin" / "go"
    go.parent.mkdir()
    go.write_text(
        '#!/bin/sh\n[ "$1" = version ] && { echo "go version go1.26.8 linux/amd64"; exit; }\necho "$PWD $5" > "$7"\n'
    )
    go.chmod(0o755)
    monkeypatch.setenv("PATH", f"{go.parent}:/usr/bin:/bin")
    env = {"PATH": f"{go.parent}:/usr/bin:/bin", "XDG_CACHE_HOME": str(tmp_path)}
    folder = versions.servers("1.35", env=env)
    assert sorted(path.name for path in folder.iterdir() if not path.name.startswith(".")) == sorted(versions.PROGRAMS)
    where, *flags = (folder / "kube-apiserver").read_text().split()
    assert where == str(pins.MODULE_DIR / "1.35")
    assert "k8s.io/component-base/version.gitVersion=v1.35.4" in flags
    assert versions.servers("1.36", env=env) != folder
    go.unlink()
    assert versions.servers("1.35", env=env) == folder, "compiled once, they need no Go"
