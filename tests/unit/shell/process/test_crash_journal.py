"""What the process died of is found by the next one: real files, the deaths played."""

import errno
import os
import shutil
import stat
import subprocess
import sys
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from tests.support.scheduler.placing import Scripted, handle_of
from tests.support.scheduling import Clock, make_cluster, make_info, make_node, owner

from robotapp_api.model.names import SCHEDULER_NAME, PodReason
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.events.cluster_event import Change, Event
from robotapp_scheduler.core.framework.interface import BindContext, PluginError
from robotapp_scheduler.core.framework.profiles import PluginRef, PluginSet, ProfileSpec, build_profiles
from robotapp_scheduler.plugins.registry import catalogue
from robotapp_scheduler.shell.binding.extension_points import ExtensionPoints
from robotapp_scheduler.shell.metrics.metrics import Metrics
from robotapp_scheduler.shell.metrics.timing import PointTimer
from robotapp_scheduler.shell.process.crash_journal import DEATHS, MARK, MOST, CrashJournal, opened

WEB = owner("ReplicaSet", "web", "rs-1")


class Dies:
    """Stands for a hook during which the process is gone."""

    name = "Dies"
    reads = ("labels",)
    asked: ClassVar[list[str]] = []

    def filter(self, pod: Any, nodes: Any) -> Any:
        self.asked.append(pod.name)
        return np.ones(nodes.n, dtype=np.bool_)

    def reserve(self, pod: Any, _node: str, _ctx: BindContext) -> None:
        self.asked.append(f"reserve {pod.name}")

    def hint(self, pod: Any, _event: Event) -> bool:
        self.asked.append(f"hint {pod.name}")
        return False


@pytest.fixture(autouse=True)
def nothing_asked() -> None:
    Dies.asked.clear()


def die(folder: Path, pod: Any, digest: str = "d1") -> None:
    """A process that asks the plugin about this pod and is never heard of again."""
    CrashJournal(folder, digest)("Dies", "filter", pod)


def core_with(journal: CrashJournal) -> SchedulerCore:
    clock = Clock()
    cluster = make_cluster(make_node("n1"), make_node("n2"), clock=clock)
    plugins = {"multiPoint": PluginSet(enabled=(PluginRef("Dies"),))}
    profiles = build_profiles([ProfileSpec(SCHEDULER_NAME, plugins=plugins)], catalogue({"Dies": Dies}))
    journal.watch_over(profiles)
    return SchedulerCore(cluster, profiles, clock=clock)


def test_a_hook_that_could_not_be_broken_off_is_not_asked_about_that_pod_by_the_next_process(tmp_path: Path) -> None:
    CrashJournal(tmp_path, "d1").stuck("Dies", "filter", make_info("bad"))
    core = core_with(CrashJournal(tmp_path, "d1"))
    decision = core.schedule_one(make_info("bad"))
    assert decision.reason is PodReason.SCHEDULER_ERROR
    assert decision.message == (
        "plugin Dies: not asked about pods like default/bad any more, because filter could not be broken off and the process "
        "had to end; a new configuration or scheduler pod asks again"
    )
    assert Dies.asked == []
    assert core.schedule_one(make_info("good", labels={"app": "good"})).placed
    assert Dies.asked == ["good"]


def test_a_death_for_an_unknown_reason_may_be_chance_and_the_second_one_in_the_same_question_is_none(
    tmp_path: Path,
) -> None:
    die(tmp_path, make_info("bad"))
    assert CrashJournal(tmp_path, "d1").barred == []
    die(tmp_path, make_info("bad"))
    (death,) = CrashJournal(tmp_path, "d1").barred
    assert "the process died 2 times while filter was asked" in str(death)
    assert [death] == CrashJournal(tmp_path, "d1").barred, "a start by itself is no death"


def test_a_process_that_ends_in_between_questions_leaves_no_mark(tmp_path: Path) -> None:
    folder = tmp_path / "0"
    for number in range(1, 4):
        core = core_with(CrashJournal(folder, "d1"))
        assert core.schedule_one(make_info("p")).placed
        folder = shutil.copytree(folder, tmp_path / str(number))  # what the next process finds
    CrashJournal(folder, "d1")
    assert not (folder / DEATHS).exists()


def test_pods_of_the_same_controller_are_alike(tmp_path: Path) -> None:
    journal = CrashJournal(tmp_path, "d1")
    journal.stuck("Dies", "filter", make_info("web-1", owner=WEB))
    with pytest.raises(PluginError, match="pods like default/web-1"):
        journal("Dies", "score", make_info("web-2", owner=WEB))
    with journal("Other", "filter", make_info("web-2", owner=WEB)), journal("Dies", "filter", make_info("web-3")):
        pass


def test_another_configuration_asks_again_at_a_start_and_while_running(tmp_path: Path) -> None:
    pod = make_info("bad")
    CrashJournal(tmp_path, "d1").stuck("Dies", "filter", pod)
    assert CrashJournal(tmp_path, "d2").barred == []
    journal = CrashJournal(tmp_path, "d1")
    journal.start_anew("d2")
    with journal("Dies", "filter", pod):
        pass
    del journal
    assert CrashJournal(tmp_path, "d2").barred == []
    assert CrashJournal(tmp_path, "d1").barred == []


async def test_hooks_on_the_way_to_the_node_and_hints_are_not_asked_either(tmp_path: Path) -> None:
    journal, pod = CrashJournal(tmp_path, "d1"), make_info("bad")
    journal.stuck("Dies", "reserve", pod)
    profile = core_with(journal).runner(SCHEDULER_NAME).profile

    async def promised(*_: Any) -> None:
        raise AssertionError

    async with ExtensionPoints(profile, pod, PointTimer(Metrics()), promised, handle=handle_of(Scripted())) as steps:
        refused = await steps.run("n1")
    assert refused is not None
    assert refused.message.startswith(
        'running Reserve plugin "Dies": plugin Dies: not asked about pods like default/bad'
    )
    assert profile.all["Dies"].queueing_hint.wants(pod, Event("pods", Change.POD_REMOVED, pod.pod, None))
    assert Dies.asked == []


def test_only_so_many_are_remembered_the_newest(tmp_path: Path) -> None:
    journal = CrashJournal(tmp_path, "d1")
    for number in range(MOST + 3):
        journal.stuck("Dies", "filter", make_info(f"p{number}"))
    del journal
    kept = [death.pod for death in CrashJournal(tmp_path, "d1").barred]
    assert kept == [f"default/p{number}" for number in range(3, MOST + 3)]


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"{",
        b'{"digest": 1}',
        b"[]",
        b'{"digest": "\xff"}',
        b'{"digest": "d1", "deaths": [{"plugin": "\xc3\x28"}]}',
        b'{"more": ' + b"[" * 100_000,
    ],
    ids=["empty", "cut off", "wrong type", "a list", "no UTF-8", "no UTF-8 inside", "deep"],
)
def test_a_file_that_cannot_be_read_is_told_once_and_nothing_is_remembered(
    tmp_path: Path, data: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / DEATHS).write_bytes(data)
    journal = opened(tmp_path, "d1")
    assert journal is not None
    assert journal.barred == []
    assert caplog.text.count("nothing is remembered") == 1
    journal.stuck("Dies", "filter", make_info("bad"))
    assert b"default/bad" in (tmp_path / DEATHS).read_bytes()


def test_a_full_disk_is_told_and_the_journal_is_off(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_handle: int, _start: int, _length: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patched:
        patched.setattr(os, "posix_fallocate", full)
        assert opened(tmp_path, "d1") is None
    assert "No space left on device" in caplog.text
    assert opened(tmp_path, "d1") is not None


HOLDS = """
import sys
from pathlib import Path
from robotapp_scheduler.shell.process.crash_journal import CrashJournal
journal = CrashJournal(Path(sys.argv[1]), "d1")
print("held", flush=True)
sys.stdin.read()
"""


def test_a_folder_another_process_uses_is_told_once_and_left_alone_until_that_is_gone(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", HOLDS, str(tmp_path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == b"held\n"
        assert opened(tmp_path, "d1") is None
        assert caplog.text.count("another process uses the folder") == 1
        other.kill()
    assert opened(tmp_path, "d1") is not None


def test_the_folder_is_ours_alone_and_links_in_it_are_not_followed(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder, theirs = tmp_path / "state", tmp_path / "theirs"
    assert opened(folder, "d1") is not None
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    theirs.write_text("precious")
    for name in (DEATHS, Path(DEATHS).with_suffix(".new")):
        (folder / name).symlink_to(theirs)
    journal = CrashJournal(folder, "d1")
    journal.stuck("Dies", "filter", make_info("bad"))
    assert "cannot be read" in caplog.text
    assert "cannot be written" in caplog.text
    del journal
    (folder / MARK).unlink()
    (folder / MARK).symlink_to(theirs)
    assert opened(folder, "d1") is None
    assert theirs.read_text() == "precious"


def test_a_folder_that_cannot_be_used_is_told_and_pods_are_placed_all_the_same(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").write_text("")
    assert opened(tmp_path / "file", "d1") is None
    assert "will not be remembered" in caplog.text
    assert opened(None, "d1") is None
    found = opened(tmp_path / "new", "d1")
    assert found is not None
    assert repr(found) == f"<CrashJournal in {tmp_path / 'new'}, 0 deaths>"
