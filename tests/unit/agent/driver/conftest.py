"""A node with a driver, in a folder whose sockets have short names."""

import shutil
import tempfile
from collections.abc import AsyncIterator, Iterator
from pathlib import Path

import pytest
from tests.support.agent.driver_node import Node
from tests.support.apiserver import FakeApiServer
from tests.support.clients import client_for


@pytest.fixture
def short_folder() -> Iterator[Path]:
    """The path of a socket has at most 107 characters."""
    folder = Path(tempfile.mkdtemp(prefix="dra-"))
    yield folder
    shutil.rmtree(folder)


@pytest.fixture
async def node(short_folder: Path) -> AsyncIterator[Node]:
    async with FakeApiServer() as api, client_for(api.endpoint) as client:
        yield Node(short_folder, api, client)
