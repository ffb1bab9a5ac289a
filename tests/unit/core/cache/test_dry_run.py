"""What is left of a dry run that cannot be undone. That others leave nothing: tests/property/core."""

import pytest
from tests.support.scheduling import make_cluster, make_info, make_node

from robotapp_scheduler.core.cache.dry_run import DryRun


def test_a_bug_while_pods_are_put_back_leaves_the_live_log_in_use(monkeypatch: pytest.MonkeyPatch) -> None:
    """With the other log every change from then on would be hidden from the scheduler, which goes on after a bug."""
    cluster = make_cluster(make_node("n0"))
    cluster.assume(make_info("p"), "n0")
    live = cluster.log

    def broken(*_: object) -> None:
        raise KeyError("a bug")

    dry_run = DryRun(cluster)
    dry_run.__enter__()
    dry_run.take(next(iter(cluster.placed.values())))
    assert cluster.log is not live
    monkeypatch.setattr(cluster, "put_on", broken)
    with pytest.raises(KeyError):
        dry_run.__exit__(None, None, None)
    assert cluster.log is live
