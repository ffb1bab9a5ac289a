"""Addresses as a browser opens them."""

from urllib.parse import parse_qs, urlsplit

from robotapp_api.values.links import write_url


def test_an_address_has_scheme_host_port_and_path() -> None:
    assert write_url("https", "127.0.0.1:4000", "/vnc.html") == "https://127.0.0.1:4000/vnc.html"


def test_foxglove_opens_in_the_browser_with_the_port_as_its_source() -> None:
    address = "https://app.foxglove.dev/?ds=foxglove-websocket&ds.url=ws%3A%2F%2F192.0.2.7%3A8765"
    assert write_url("foxglove", "192.0.2.7:8765", "") == address
    assert "ds=rosbridge-websocket" in write_url("rosbridge", "192.0.2.7:9090", "")


def test_a_path_stays_part_of_the_source_and_adds_nothing_to_the_page() -> None:
    query = parse_qs(urlsplit(write_url("foxglove", "192.0.2.7:8765", "/a?token=b&ds=other#c")).query)
    assert query == {"ds": ["foxglove-websocket"], "ds.url": ["ws://192.0.2.7:8765/a?token=b&ds=other#c"]}
