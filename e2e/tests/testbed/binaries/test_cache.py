import os
import platform
import shutil
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotapp_testbed import wait_until
from robotapp_testbed.binaries import cache, pins


@pytest.fixture
def store(tmp_path: Path) -> cache.Store:
    return cache.Store(tmp_path / "store")


def add(store: cache.Store, name: str, text: str) -> bool:
    """True when this call made it."""
    with store.adding(name) as target:
        if target:
            target.write_text(text)
        return target is not None


@pytest.mark.parametrize(
    ("env", "expected"),
    [
        ({"XDG_CACHE_HOME": "/x/cache", "HOME": "/h"}, "/x/cache/robotapp"),
        ({"XDG_CACHE_HOME": "relative", "HOME": "/h"}, "/h/.cache/robotapp"),
        ({"HOME": "/h"}, "/h/.cache/robotapp"),
    ],
)
def test_the_cache_is_where_the_xdg_specification_says(env: dict[str, str], expected: str) -> None:
    assert cache.cache_home(env) == Path(expected)


def test_the_cache_is_outside_the_repository() -> None:
    assert not cache.cache_home().is_relative_to(pins.REPOSITORY)


@pytest.mark.parametrize("changed", ["go.mod", "go.sum"])
def test_the_key_follows_the_modules(changed: str, tmp_path: Path) -> None:
    for name in ("go.mod", "go.sum"):
        shutil.copy(pins.MODULE_DIR / name, tmp_path)
    before = cache.module_key(module_dir=tmp_path)
    assert before == cache.module_key(module_dir=pins.MODULE_DIR)
    (tmp_path / changed).write_text("other")
    assert cache.module_key(module_dir=tmp_path) != before


def test_the_key_follows_the_flags() -> None:
    assert cache.module_key() != cache.module_key(ldflags=pins.ldflags("v1.36.3"))


def test_machines_of_two_kinds_that_share_a_home_have_binaries_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    keys = set()
    for machine in ("x86_64", "aarch64"):
        monkeypatch.setattr(platform, "machine", lambda machine=machine: machine)
        keys |= {cache.module_key(), cache.release_key()}
    assert len(keys) == 4


@given(first=st.text(), second=st.text())
def test_moving_text_between_the_parts_of_the_key_changes_it(
    first: str, second: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("module")
    (folder / "go.mod").write_text("a" + first)
    (folder / "go.sum").write_text(second)
    before = cache.module_key(module_dir=folder)
    (folder / "go.mod").write_text(first)
    (folder / "go.sum").write_text("a" + second)
    assert cache.module_key(module_dir=folder) != before


def test_a_finished_binary_is_there_and_executable(store: cache.Store) -> None:
    assert store.get("etcd") is None
    assert add(store, "etcd", "binary")
    path = store.get("etcd")
    assert path is not None
    assert path.read_text() == "binary"
    assert os.access(path, os.X_OK)


def test_what_is_there_is_not_made_again(store: cache.Store) -> None:
    assert add(store, "etcd", "first")
    assert not add(store, "etcd", "second")
    assert store.path("etcd").read_text() == "first"


def test_a_failure_leaves_nothing_that_looks_finished(store: cache.Store) -> None:
    def fail() -> None:
        with store.adding("etcd") as target:
            assert target is not None
            target.write_text("half")
            raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        fail()
    assert store.get("etcd") is None
    assert [path.name for path in store.directory.iterdir()] == [".etcd.lock"]


def test_the_remains_of_a_killed_caller_are_removed(store: cache.Store) -> None:
    store.directory.mkdir()
    (store.directory / ".etcd.4711.partial").write_text("half")
    (store.directory / ".etcd.4711.partial.download").write_text("half")
    (store.directory / ".etcd.4711.partial-x7" / "b001").mkdir(parents=True)
    assert add(store, "etcd", "whole")
    assert {path.name for path in store.directory.iterdir()} == {".etcd.lock", ".etcd.size", "etcd"}


@pytest.mark.parametrize("damage", ["", "wh", "whole and more"])
def test_a_binary_of_another_size_than_it_had_is_made_again(damage: str, store: cache.Store) -> None:
    assert add(store, "etcd", "whole")
    store.path("etcd").write_text(damage)
    assert store.get("etcd") is None
    assert add(store, "etcd", "whole")
    assert store.get("etcd") is not None


@pytest.mark.parametrize("record", [None, "", "five"])
def test_a_binary_without_the_record_that_comes_last_is_made_again(record: str | None, store: cache.Store) -> None:
    assert add(store, "etcd", "whole")
    file = store.directory / ".etcd.size"
    file.unlink() if record is None else file.write_text(record)
    assert store.get("etcd") is None
    assert add(store, "etcd", "again")
    assert store.path("etcd").read_text() == "again"


def test_a_damaged_binary_is_made_again_once_by_two_callers(store: cache.Store) -> None:
    add(store, "etcd", "whole")
    store.path("etcd").write_text("w")
    callers = [threading.Thread(target=add, args=(store, "etcd", text)) for text in ("first", "other")]
    for caller in callers:
        caller.start()
    for caller in callers:
        caller.join(10)
    assert store.get("etcd") is not None
    assert store.path("etcd").read_text() in ("first", "other")


def test_two_callers_at_once_do_the_work_once(store: cache.Store) -> None:
    waiting, made = threading.Event(), []

    def second() -> None:
        with store.adding("etcd", on_wait=waiting.set) as target:
            made.append(target is not None)

    with store.adding("etcd") as target:
        other = threading.Thread(target=second)
        other.start()
        assert waiting.wait(5), "the second caller is told that it waits"
        assert target is not None
        target.write_text("once")
    other.join(5)
    assert made == [False]
    assert store.path("etcd").read_text() == "once"


def test_callers_for_different_binaries_do_not_wait_for_each_other(store: cache.Store) -> None:
    with store.adding("etcd"):
        assert add(store, "helm", "meanwhile")


def test_the_lock_ends_with_a_holder_that_is_killed(store: cache.Store) -> None:
    code = (
        "import sys, time; from pathlib import Path; from robotapp_testbed.binaries.cache import Store\n"
        "with Store(Path(sys.argv[1])).adding('etcd') as target:\n"
        "    target.write_text('half'); print('held', flush=True); time.sleep(60)"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code, str(store.directory)], stdout=subprocess.PIPE, text=True
    ) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        holder.send_signal(signal.SIGKILL)
        holder.wait()
    assert add(store, "etcd", "whole")
    assert wait_until(lambda: store.get("etcd") is not None, timeout_s=60)
