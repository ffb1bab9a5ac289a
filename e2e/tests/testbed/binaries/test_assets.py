"""The order in which binaries are looked for, with a stand-in release host and a shell script in Go's place."""

import io
import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from e2e.tests.testbed.release_server import ReleaseServer, serving
from tests.support.work_unit import is_in_time

from robotapp_testbed import TestbedError
from robotapp_testbed.binaries import cache, pins
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


def test_our_variable_comes_before_that_of_kubebuilder(machine: Machine, tmp_path: Path) -> None:
    ours = machine.program(tmp_path / "ours", "etcd", "")
    machine.program(tmp_path / "theirs", "etcd", "")
    assets = machine.assets(ROBOTAPP_ASSETS=str(tmp_path / "ours"), KUBEBUILDER_ASSETS=str(tmp_path / "theirs"))
    assert assets.resolve(["etcd"]) == {"etcd": ours}


def test_what_the_folder_lacks_comes_from_the_cache(machine: Machine, tmp_path: Path) -> None:
    given = machine.program(tmp_path / "given", "etcd", "")
    cached = machine.cached(cache.release_store(home=machine.home), "helm")
    found = machine.assets(KUBEBUILDER_ASSETS=str(tmp_path / "given")).resolve(["etcd", "helm"])
    assert found == {"etcd": given, "helm": cached}


def test_a_variable_that_names_no_folder_is_explained(machine: Machine) -> None:
    with pytest.raises(TestbedError, match=r"ROBOTAPP_ASSETS=/no/such is not a folder.*unset ROBOTAPP_ASSETS"):
        machine.assets(ROBOTAPP_ASSETS="/no/such").resolve(["etcd"])


def test_the_cache_of_compiled_binaries_is_used_without_asking_anybody(machine: Machine, server: ReleaseServer) -> None:
    cached = machine.cached(cache.built_store(home=machine.home), "etcd")
    assert machine.assets(server.base_urls()).resolve(["etcd"]) == {"etcd": cached}
    assert server.requests == []


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


def test_unreachable_sources_are_asked_once_each_and_cost_seconds_at_most(
    machine: Machine, server: ReleaseServer
) -> None:
    machine.install_go()
    urls = server.base_urls()
    server.stop.set()
    server.files.clear()
    started = time.monotonic()
    found = machine.assets({**urls, "kubernetes": f"{urls['kubernetes']}/absent"}).resolve()
    assert is_in_time(time.monotonic() - started, 5)
    assert set(found) == set(pins.NAMES)
    assert sum("/absent/" in path for path in server.requests) == 1, "four Kubernetes binaries, one question"


def test_the_user_sees_step_number_name_and_time_left(machine: Machine) -> None:
    machine.install_go()
    machine.assets().resolve(["kube-apiserver", "helm"])
    lines = machine.said.getvalue().splitlines()
    assert lines[0] == f"Control plane: getting kube-apiserver, helm into {machine.home}"
    assert lines[1].startswith("[1/2] compiling kube-apiserver: about ")
    assert lines[1].endswith(" left")
    assert lines[2] == "[1/2] compiling kube-apiserver: done in 0 s"
    assert lines[3].startswith("[2/2] compiling helm: ")


def test_an_interrupted_build_goes_on_where_it_was(machine: Machine) -> None:
    machine.install_go(f'{COMPILES}; case "$8" in *helm*) rm "$7"; echo broken >&2; exit 1;; esac')
    with pytest.raises(TestbedError, match="helm could not be compiled"):
        machine.assets().resolve(["etcd", "helm"])
    machine.install_go(f'{COMPILES}; case "$8" in *etcd*) echo "etcd again" >&2; exit 1;; esac')
    assert machine.assets().resolve(["etcd", "helm"])["helm"].read_text().startswith("compiled helm.sh")


def test_two_callers_at_once_compile_each_binary_once(machine: Machine, tmp_path: Path) -> None:
    machine.install_go(f'{COMPILES}; echo "$8" >> {tmp_path}/compiled')
    results: list[dict[str, Path]] = []
    threads = [threading.Thread(target=lambda: results.append(machine.assets().resolve())) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert results[0] == results[1]
    assert sorted((tmp_path / "compiled").read_text().split()) == sorted(binary.package for binary in pins.BINARIES)


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


def test_what_is_still_missing_is_compiled_by_the_go_of_now_beside_what_another_compiled(machine: Machine) -> None:
    machine.install_go()
    first = machine.assets().resolve(["etcd"])["etcd"]
    machine.install_go(COMPILES.replace("1.26.0", "1.26.9").replace("compiled %s", "newer %s"))
    both = machine.assets().resolve(["etcd", "kwok"])
    assert both["etcd"] == first
    assert both["kwok"].read_text().startswith("newer ")
    assert both["kwok"].parent == first.parent


def test_a_damaged_binary_is_compiled_again(machine: Machine) -> None:
    machine.install_go()
    found = machine.assets().resolve(["etcd"])["etcd"]
    whole = found.read_bytes()
    found.write_bytes(whole[:5])
    assert machine.assets().present(["etcd"]) == {}
    assert machine.assets().resolve(["etcd"])["etcd"].read_bytes() == whole


def test_a_cache_that_cannot_be_written_is_explained(machine: Machine) -> None:
    machine.install_go()
    machine.home.write_text("a file is in the way")
    with pytest.raises(TestbedError, match="set XDG_CACHE_HOME to a folder you may write"):
        machine.assets().resolve(["etcd"])


def test_present_only_looks(machine: Machine) -> None:
    assert machine.assets().present() == {}
    assert not machine.home.exists()
