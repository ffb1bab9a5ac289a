"""Round trips as data: what the operator's program prints, read back and summed up. Standard library only."""

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Final

HEADER: Final = "kind,number,at_us,rtt_us"
"""Columns of the program's CSV: `sent` rows have an empty rtt_us; times are of the operator's own clock."""

FOREIGN: Final = "foreign"
FRAME: Final = "frame"
READY: Final = "ready"
SENT: Final = "sent"
TRIP: Final = "trip"


@dataclass(frozen=True, slots=True)
class Row:
    """`at_us` since the program's start. A trip has the number of the command it answers; a foreign row is a message
    of somebody else's app; a frame row is a camera image, its number the bytes."""

    kind: str
    number: int
    at_us: int
    rtt_us: int | None = None

    def as_csv(self) -> str:
        return f"{self.kind},{self.number},{self.at_us},{'' if self.rtt_us is None else self.rtt_us}"


@dataclass(frozen=True, slots=True)
class Summary:
    """Of one run. Percentiles are None without trips. `missed`: not answered within the deadline, or never."""

    sent: int
    answered: int
    missed: int
    foreign: int
    frames: int
    p50_us: int | None
    p95_us: int | None
    p99_us: int | None
    max_us: int | None
    longest_gap_us: int
    """Between two answers that follow each other."""

    @property
    def missed_share(self) -> float:
        return self.missed / self.sent if self.sent else 0.0

    def as_json(self) -> str:
        return json.dumps(asdict(self))


def parse(lines: Iterable[str]) -> list[Row]:
    """Rows of the CSV; lines that are none (a log message between them) are passed over."""
    found = []
    for line in lines:
        fields = line.strip().split(",")
        if len(fields) == 4 and fields[0] in (FOREIGN, FRAME, READY, SENT, TRIP):
            kind, number, at_us, rtt_us = fields
            found.append(Row(kind, int(number), int(at_us), int(rtt_us) if rtt_us else None))
    return found


def summarise(rows: Sequence[Row], *, deadline_us: int, settle_us: int = 0) -> Summary:
    """Commands of the first `settle_us`, and of the last deadline before the end (they may yet be answered), do not count."""
    last_us = max((row.at_us for row in rows), default=0)
    counted = {row.number for row in rows if row.kind == SENT and settle_us <= row.at_us <= last_us - deadline_us}
    trips = [row for row in rows if row.kind == TRIP and row.number in counted]
    rtts = sorted(row.rtt_us for row in trips if row.rtt_us is not None)
    in_time = {row.number for row in trips if row.rtt_us is not None and row.rtt_us <= deadline_us}
    times = [row.at_us for row in trips]
    return Summary(
        sent=len(counted),
        answered=len({row.number for row in trips}),
        missed=len(counted - in_time),
        foreign=sum(row.kind == FOREIGN for row in rows),
        frames=sum(row.kind == FRAME for row in rows),
        p50_us=percentile(rtts, 50),
        p95_us=percentile(rtts, 95),
        p99_us=percentile(rtts, 99),
        max_us=rtts[-1] if rtts else None,
        longest_gap_us=max((after - before for before, after in pairwise(times)), default=0),
    )


def percentile(ordered: Sequence[int], share: float) -> int | None:
    """Nearest rank: the least value that `share` percent of all do not exceed."""
    return ordered[max(math.ceil(len(ordered) * share / 100) - 1, 0)] if ordered else None
