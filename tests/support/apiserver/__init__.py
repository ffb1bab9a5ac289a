"""A small API server in the test's own loop: lists, watches, versions, conflicts and bindings, no schema, no rights.

For fast unit tests only. `tests/live/client` runs the same contract tests on it and on the real API server.
"""

from tests.support.apiserver.server import FakeApiServer
from tests.support.apiserver.store import Key, Refused, Store

__all__ = ["FakeApiServer", "Key", "Refused", "Store"]
