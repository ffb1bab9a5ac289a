"""Keeps what each compile took on this machine, as the estimate of the next one: a small file in the cache."""

import json
import os
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from robotapp_testbed import estimate
from robotapp_testbed.binaries import cache, pins

_FILE: Final = "durations.json"
_LONGEST_S: Final = 86_400
_MOST_PACKAGES: Final = 1_000_000
_REFERENCE_CORES: Final = 2
_MOST_CORES: Final = 8
"""More cores than this make the compile hardly faster: its longest packages and the linker use one each."""


@dataclass(frozen=True, slots=True)
class Measurement:
    seconds: float
    packages: int
    """How many packages were compiled; the others came from Go's own cache."""

    def is_comparable(self, binary: pins.Binary) -> bool:
        """Returns whether about as many packages were compiled as `binary` has by itself, when those before it are there.

        A filled cache of Go leaves fewer; a binary that is compiled first has those of others to compile as well.
        """
        return binary.packages <= 2 * self.packages <= 4 * binary.packages


def read_measurements(home: Path) -> dict[str, Measurement]:
    """Returns the measurements by name of the program; those that cannot be read are left out."""
    try:
        document = json.loads((home / _FILE).read_text())
    except (OSError, ValueError, RecursionError):
        return {}
    entries = document if isinstance(document, dict) else {}
    measurements = ((name, _parse_measurement(entry)) for name, entry in entries.items())
    return {name: measurement for name, measurement in measurements if measurement}


def record_measurement(home: Path, binary: pins.Binary, measurement: Measurement) -> None:
    """Keeps a comparable measurement, the latest of each binary. A cache that takes no file costs the estimate, not the compile."""
    if not measurement.is_comparable(binary):
        return
    with suppress(OSError), cache.locked(home / f".{_FILE}.lock"):
        measurements = read_measurements(home)
        measurements[binary.name] = measurement
        entries = {key: asdict(value) for key, value in sorted(measurements.items())}
        partial = home / f".{_FILE}.{os.getpid()}.partial"
        partial.write_text(json.dumps(entries, indent=1) + "\n")
        partial.replace(home / _FILE)


def expect_durations(
    binaries: Iterable[pins.Binary], home: Path, *, cores: int | None = os.cpu_count()
) -> dict[str, float]:
    """Returns the seconds that compiling each of `binaries` should take on this machine."""
    wanted = {binary.name: float(binary.compile_s) for binary in binaries}
    table = {binary.name: float(binary.compile_s) for binary in pins.BINARIES} | wanted
    measured = {name: measurement.seconds for name, measurement in read_measurements(home).items()}
    pace = _REFERENCE_CORES / min(cores or _REFERENCE_CORES, _MOST_CORES)
    return estimate.expect_durations(wanted, table, measured, unmeasured_pace=pace)


def _parse_measurement(entry: object) -> Measurement | None:
    fields: Mapping[str, Any] = entry if isinstance(entry, dict) else {}
    seconds, packages = fields.get("seconds"), fields.get("packages")
    if not isinstance(seconds, int | float) or not 0 < seconds < _LONGEST_S:
        return None
    if not isinstance(packages, int) or not 0 < packages < _MOST_PACKAGES:
        return None
    return Measurement(float(seconds), packages)
