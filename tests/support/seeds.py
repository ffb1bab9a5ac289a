"""Seeds of campaigns that take another sample every day."""

import datetime as dt
import os


def daily_seed() -> int:
    """Another number every day; ROBOTAPP_SEED repeats a given one."""
    return int(os.environ.get("ROBOTAPP_SEED", "0")) or dt.datetime.now(tz=dt.UTC).toordinal()
