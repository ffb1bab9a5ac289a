"""The order in which binaries are looked for, with a stand-in release host and a shell script in Go's place."""

import io
import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from e2e.tests.testbed.release_server import ReleaseServer, serving

from robotapp_testbed import TestbedError
from robotapp_testbed.binaries import cache, durations, pins
from robotapp_testbed.binaries.assets import Assets
from robotapp_testbed.progress import Progress

NOWHERE = dict.fromkeys(pins.BASE_URLS, "")
COMPILES = '[ "$1" = version ] && { echo go version go1.26.0 linux/amd64; exit; }; printf "compiled %s" "$8" > "$7"'


@pytest.fixture
def server() -> Iterator[ReleaseServer]:
    with serving() as running:
        yield running


class Machine:
    """A home, a PATH and what the user is told."""

    def __init__(self, folder: Path) -> None:
        self.home = folder / "cache"
        self.bin = folder / "bin"
        self.bin.mkdir()
        self.said = io.StringIO()
        # The script needs a shell and printf only, so nothing of the real machine is on its PATH.
        self.env = {"PATH": str(self.bin), "HOME": str(folder)}

    def install_go(self, script: str = COMPILES) -> None:
        self.program(self.bin, "go", f"#!/bin/sh\n{script}\n")

    def program(self, folder: Path, name: str, text: str) -> Path:
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / name
        path.write_text(text)
        path.chmod(0o755)
        return path

    def cached(self, store: cache.Store, name: str) -> Path:
        with store.adding(name) as target:
            assert target is not None
            target.write_text("cached")
        return store.path(name)

    def assets(self, urls: dict[str, str] | None = None, **env: str) -> Assets:
        progress = Progress(self.said, interactive=False)
        return Assets(env={**self.env, **env}, home=self.home, progress=progress, base_urls=urls or NOWHERE)


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    return Machine(tmp_path)


@pytest.mark.parametrize("variable", ["ROBOTAPP_ASSETS", "KUBEBUILDER_ASSETS"])
def test_a_given_folder_comes_first(variable: str, machine: Machine, tmp_path: Path) -> None:
    given = machine.program(tmp_path / "given", "etcd", "given")
    machine.cached(cache.release_store(home=machine.home), "etcd")
    found = machine.assets(**{variable: str(tmp_path / "given")}).resolve(["etcd"])
    assert found == {"etcd": given}
    assert machine.said.getvalue() == ""


def test_a_missing_binary_is_downloaded_before_it_is_compiled(machine: Machine, server: ReleaseServer) -> None:
    machine.install_go()
    server.publish(pins.binary("kubectl"), b"released")
    found = machine.assets(server.base_urls()).resolve(["kubectl"])
    assert found["kubectl"].read_text() == "released"
    assert os.access(found["kubectl"], os.X_OK)
    asked = len(server.requests)
    assert machine.assets(server.base_urls()).resolve(["kubectl"]) == found
    assert len(server.requests) == asked, "the second time it is in the cache"


def test_what_cannot_be_downloaded_is_compiled(machine: Machine, server: ReleaseServer) -> None:
    machine.install_go()
    server.publish(pins.binary("etcd"), b"tampered", digest="f" * 64)
    server.publish(pins.binary("helm"), b"released")
    found = machine.assets(server.base_urls()).resolve(["etcd", "kwok", "helm"])
    assert found["etcd"].read_text() == "compiled go.etcd.io/etcd/server/v3"
    assert found["kwok"].read_text() == "compiled sigs.k8s.io/kwok/cmd/kwok"
    assert found["helm"].read_text() == "released"
    assert "does not match its published checksum" in machine.said.getvalue()


@pytest.mark.parametrize("later", ["1.26.9", "1.27.0", "1.25.3", "none", "broken"])
def test_binaries_once_compiled_are_used_whatever_go_is_there_later(later: str, machine: Machine) -> None:
    machine.install_go()
    first = machine.assets().resolve(["etcd"])
    machine.said.truncate(0)
    (machine.bin / "go").unlink()
    if later != "none":
        machine.install_go(f"echo go version go{later} linux/amd64; echo compiled >&2; exit 1")
    assert machine.assets().resolve(["etcd"]) == first
    assert machine.said.getvalue() == ""


def test_a_cache_that_cannot_be_written_is_explained(machine: Machine) -> None:
    machine.install_go()
    machine.home.write_text("a file is in the way")
    with pytest.raises(TestbedError, match="set XDG_CACHE_HOME to a folder you may write"):
        machine.assets().resolve(["etcd"])


def test_the_next_compile_is_expected_to_take_what_this_one_took(machine: Machine) -> None:
    packages = "\n".join(f"example.org/package-{number}" for number in range(6))
    machine.install_go(f"{COMPILES}; echo 'go: downloading m v1\n{packages}' >&2")
    machine.assets().resolve(["kube-scheduler"])
    measurement = durations.read_measurements(machine.home)["kube-scheduler"]
    assert measurement.packages == 6
    scheduler = pins.binary("kube-scheduler")
    assert durations.expect_durations([scheduler], machine.home) == {"kube-scheduler": measurement.seconds}


def test_binaries_are_compiled_in_the_order_in_which_their_shares_were_measured(machine: Machine) -> None:
    machine.install_go()
    machine.assets().resolve(["helm", "kwok", "etcd"])
    assert machine.said.getvalue().startswith("Control plane: getting etcd, kwok, helm into ")
