"""What a process and its children use."""

import os
import subprocess

from campaigns.common.process_use import queued_s, tree, tree_rss_bytes


def test_memory_is_that_of_a_process_and_of_all_below_it() -> None:
    with subprocess.Popen(["sleep", "60"]) as child:
        try:
            assert {os.getpid(), child.pid} <= set(tree(os.getpid()))
            assert tree_rss_bytes(os.getpid()) > tree_rss_bytes(child.pid) > 0
        finally:
            child.kill()


def test_a_process_that_has_ended_counts_as_nothing() -> None:
    with subprocess.Popen(["true"]) as ended:
        ended.wait()
    assert (tree_rss_bytes(ended.pid), queued_s([ended.pid])) == (0, 0.0)
