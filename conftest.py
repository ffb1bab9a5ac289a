"""Settings of every test."""

import gc
import logging
import os
import signal
from collections.abc import Iterator

import pytest
from hypothesis import settings
from tests.support.seeds import TODAY, count_examples, daily_seed

# How long an example takes says something about the machine's other work, not about the rule under test.
settings.register_profile("untimed", deadline=None, max_examples=count_examples(100))
settings.load_profile("untimed")

# Processes of pytest-xdist that begin before and after midnight have the same tests: they inherit the day.
os.environ.setdefault(TODAY, str(daily_seed()))

# A shell's background jobs ignore Ctrl-C, and so would every program they start: some tests send it to theirs.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """An id with an address in it differs from process to process: it cannot be named on a command line, nor shared out."""
    if moving := [item.nodeid for item in items if " at 0x" in item.nodeid]:
        raise pytest.UsageError("give these parameters ids of their own:\n" + "\n".join(moving))


@pytest.hookimpl(trylast=True)
def pytest_collection_finish() -> None:
    """Thousands of tests and their modules stay until the end: the collector need not walk them again and again."""
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True)
def restore_logging() -> Iterator[None]:
    """Takes back what a program that ran inside the test did to logging: its level would hide what the next test looks for."""
    named_loggers = [item for item in logging.root.manager.loggerDict.values() if isinstance(item, logging.Logger)]
    levels = {logger: logger.level for logger in (logging.root, *named_loggers)}
    handlers = logging.root.handlers[:]
    yield
    logging.root.handlers[:] = handlers
    for logger, level in levels.items():
        if logger.level != level:
            logger.setLevel(level)
