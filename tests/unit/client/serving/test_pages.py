"""What the pages that need rights take for the address of a caller."""

import pytest
from aiohttp.test_utils import make_mocked_request

from robotapp_client.serving.pages import caller


@pytest.mark.parametrize(
    ("peer", "address"),
    [("10.0.0.7", "10.0.0.7"), ("::ffff:10.0.0.7", "10.0.0.7"), ("fd00::1:2:3:4", "fd00::/64"), ("", "")],
)
def test_all_addresses_of_a_host_are_one_caller(peer: str, address: str) -> None:
    """So guesses of tokens are limited for a host that has an IPv6 network of its own."""
    request = make_mocked_request("GET", "/metrics", headers={"Authorization": "Bearer guess"}).clone(remote=peer)
    assert (caller(request).token, caller(request).address) == ("guess", address)
