import os
from pathlib import Path

from robotapp_testbed.processes import logs


def test_the_ten_newest_logs_are_kept(tmp_path: Path) -> None:
    for number in range(12):
        source = tmp_path / "source"
        source.mkdir()
        (source / "etcd.log").write_text(str(number))
        target = tmp_path / "kept" / f"run-{number}"
        logs.keep(source, target)
        os.utime(target, (number, number))
    kept = {path.name for path in (tmp_path / "kept").iterdir()}
    assert kept == {f"run-{number}" for number in range(2, 12)}
    assert (tmp_path / "kept" / "run-11" / "etcd.log").read_text() == "11"
    assert not (tmp_path / "source").exists()
