"""What compiling took is remembered by the machine, whatever happens to the file."""

import json
import threading
from pathlib import Path

import pytest

from robotapp_testbed.binaries import durations, pins
from robotapp_testbed.binaries.durations import Measurement

ETCD = Measurement(50.5, 567)


def write(home: Path, text: str) -> None:
    (home / "durations.json").write_text(text)


def record(home: Path, name: str, measurement: Measurement) -> None:
    durations.record_measurement(home, pins.binary(name), measurement)


def test_a_measurement_is_read_as_it_was_recorded(tmp_path: Path) -> None:
    record(tmp_path, "etcd", ETCD)
    record(tmp_path, "kwok", Measurement(17, 68))
    assert durations.read_measurements(tmp_path) == {"etcd": ETCD, "kwok": Measurement(17, 68)}


def test_the_latest_measurement_counts(tmp_path: Path) -> None:
    record(tmp_path, "etcd", ETCD)
    record(tmp_path, "etcd", Measurement(30, 300))
    assert durations.read_measurements(tmp_path) == {"etcd": Measurement(30, 300)}


@pytest.mark.parametrize("packages", [0, 90, 400, 914])
def test_a_compile_of_far_fewer_or_more_packages_than_usual_is_no_measurement(packages: int, tmp_path: Path) -> None:
    """Fewer: Go's cache was filled. More: it had those to compile that other binaries bring along otherwise."""
    usual = Measurement(25, 191)
    record(tmp_path, "kubectl", usual)
    record(tmp_path, "kubectl", Measurement(2, packages))
    assert durations.read_measurements(tmp_path) == {"kubectl": usual}


@pytest.mark.parametrize(
    "text",
    ["", "{", "[]", "null", '"x"', "[" * 100_000, '{"etcd": 50}', '{"etcd": {"seconds": 50}}']
    + [
        f'{{"etcd": {{"seconds": {seconds}, "packages": 5}}}}'
        for seconds in ("-1", "0", "NaN", "Infinity", '"5"', "null")
    ]
    + [f'{{"etcd": {{"seconds": 5, "packages": {packages}}}}}' for packages in ("0", "1.5", "1e999", "9" * 400)],
)
def test_a_broken_file_is_no_measurement_and_is_replaced_by_the_next(text: str, tmp_path: Path) -> None:
    write(tmp_path, text)
    assert durations.read_measurements(tmp_path) == {}
    record(tmp_path, "etcd", ETCD)
    assert durations.read_measurements(tmp_path) == {"etcd": ETCD}


def test_what_is_no_text_is_no_measurement(tmp_path: Path) -> None:
    (tmp_path / "durations.json").write_bytes(b"\xff\xfe\x00")
    assert durations.read_measurements(tmp_path) == {}


def test_of_a_half_broken_file_the_rest_counts(tmp_path: Path) -> None:
    write(tmp_path, json.dumps({"etcd": {"seconds": 50.5, "packages": 567, "more": 1}, "kwok": []}))
    assert durations.read_measurements(tmp_path) == {"etcd": ETCD}


def test_a_cache_that_takes_no_file_is_no_failure(tmp_path: Path) -> None:
    home = tmp_path / "in the way"
    home.touch()
    record(home, "etcd", ETCD)
    assert durations.read_measurements(home) == {}


def test_measurements_of_several_callers_at_once_are_all_kept(tmp_path: Path) -> None:
    measurements = {binary.name: Measurement(9, binary.packages) for binary in pins.BINARIES}
    threads = [threading.Thread(target=record, args=(tmp_path, *item)) for item in measurements.items()]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert durations.read_measurements(tmp_path) == measurements
    assert not list(tmp_path.glob("*.partial"))


def test_what_was_never_compiled_here_is_expected_at_the_pace_of_what_was(tmp_path: Path) -> None:
    etcd, kubelet = pins.binary("etcd"), pins.binary("kubelet")
    assert durations.expect_durations([kubelet], tmp_path, cores=4) == {"kubelet": kubelet.compile_s / 2}
    record(tmp_path, "etcd", Measurement(etcd.compile_s * 3.0, 567))
    assert durations.expect_durations([kubelet], tmp_path, cores=4) == {"kubelet": kubelet.compile_s * 3}


def test_programs_of_our_own_are_expected_at_the_same_pace(tmp_path: Path) -> None:
    record(tmp_path, "etcd", Measurement(pins.binary("etcd").compile_s * 3.0, 567))
    own = pins.Binary(name="pause", package=".", compile_s=5, packages=1, release=None)
    assert durations.expect_durations([own], tmp_path) == {"pause": 15}
