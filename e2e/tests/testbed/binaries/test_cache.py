import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from robotapp_testbed import wait_until
from robotapp_testbed.binaries import cache


@pytest.fixture
def store(tmp_path: Path) -> cache.Store:
    return cache.Store(tmp_path / "store")


def add(store: cache.Store, name: str, text: str) -> bool:
    """True when this call made it."""
    with store.adding(name) as target:
        if target:
            target.write_text(text)
        return target is not None


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


@pytest.mark.parametrize("damage", ["", "wh", "whole and more"])
def test_a_binary_of_another_size_than_it_had_is_made_again(damage: str, store: cache.Store) -> None:
    assert add(store, "etcd", "whole")
    store.path("etcd").write_text(damage)
    assert store.get("etcd") is None
    assert add(store, "etcd", "whole")
    assert store.get("etcd") is not None


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
