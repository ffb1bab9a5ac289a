"""Authorities and certificates are files that are replaced while we run: new connections follow them."""

import logging
import ssl
from pathlib import Path

import pytest
import yaml
from tests.unit.client.transport.test_tls_sessions import connected, tls_server

from robotapp_client.transport.connect import Dialer, NotSentError
from robotapp_client.transport.errors import LoginError
from robotapp_client.transport.kubeconfig import Endpoint, follow_authority, load
from robotapp_testbed.control_plane.authority import Authority


def replace(path: Path, text: str) -> None:
    """As the kubelet does it: another file under the same name."""
    fresh = path.with_suffix(".new")
    fresh.write_text(text)
    fresh.rename(path)


def trusted(context: ssl.SSLContext | None) -> list[str]:
    assert context is not None
    return [dict(pair for (pair,) in authority["subject"])["commonName"] for authority in context.get_ca_certs()]  # type: ignore[misc,index]


async def test_a_rotated_authority_is_trusted_by_the_next_connection_and_the_old_one_no_longer(tmp_path: Path) -> None:
    old, new = Authority("old"), Authority("new")
    ca = tmp_path / "ca.crt"
    ca.write_text(old.pem)
    security = follow_authority(ca)
    async with tls_server(tmp_path / "old", old) as port:
        dialer = Dialer(Endpoint(f"https://localhost:{port}", security))
        standing = await connected(dialer)
        replace(ca, new.pem)
        with pytest.raises(NotSentError, match="CERTIFICATE_VERIFY_FAILED"):
            await connected(dialer)
        assert standing.reusable, "connections that stand go on"
        await dialer.close()
    async with tls_server(tmp_path / "new", new) as port:
        dialer = Dialer(Endpoint(f"https://localhost:{port}", security))
        await connected(dialer)
        await dialer.close()


def test_a_file_that_cannot_be_used_changes_nothing_and_the_next_one_is_taken(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    ca = tmp_path / "ca.crt"
    ca.write_text(Authority("old").pem)
    security = follow_authority(ca)
    before = security.context
    with caplog.at_level(logging.WARNING):
        replace(ca, "half a certifi")
        assert security.context is before
        ca.unlink()
        assert security.context is before
    assert "the authorities and certificates in use stay" in caplog.text
    replace(ca, Authority("new").pem)
    assert trusted(security.context) == ["new"]
    assert security.context is security.context


def test_one_that_is_not_there_at_the_start_is_an_error_with_its_name(tmp_path: Path) -> None:
    with pytest.raises(LoginError, match=str(tmp_path / "nowhere")):
        follow_authority(tmp_path / "nowhere")


def write_kubeconfig(folder: Path, user: dict[str, str], authority: str) -> Path:
    config = {
        "clusters": [{"name": "c", "cluster": {"server": "https://localhost", "certificate-authority": authority}}],
        "users": [{"name": "u", "user": user}],
        "contexts": [{"name": "x", "context": {"cluster": "c", "user": "u"}}],
        "current-context": "x",
    }
    path = folder / "kubeconfig"
    replace(path, yaml.safe_dump(config))
    return path


def test_files_beside_a_kubeconfig_and_the_kubeconfig_itself_are_followed(tmp_path: Path) -> None:
    authority = Authority("old")
    (tmp_path / "ca.crt").write_text(authority.pem)
    (tmp_path / "other.crt").write_text(Authority("other").pem)
    certificate, key = authority.user(tmp_path, "amy")
    user = {"client-certificate": certificate.name, "client-key": key.name}
    endpoint = load(write_kubeconfig(tmp_path, user, "ca.crt"))
    contexts = [endpoint.tls]
    for renew in (
        lambda: replace(tmp_path / "ca.crt", Authority("new").pem),
        lambda: authority.user(tmp_path, "amy"),
        lambda: write_kubeconfig(tmp_path, user, "other.crt"),
    ):
        renew()
        assert endpoint.tls is not contexts[-1]
        contexts.append(endpoint.tls)
        assert endpoint.tls is contexts[-1]
    assert trusted(contexts[-1]) == ["other"]


async def test_a_token_in_a_kubeconfig_is_read_again_when_it_is_refused(tmp_path: Path) -> None:
    (tmp_path / "ca.crt").write_text(Authority("ca").pem)
    credentials = load(write_kubeconfig(tmp_path, {"token": "old"}, "ca.crt")).credentials
    assert (credentials.authorization, credentials.due) == ("Bearer old", False)
    write_kubeconfig(tmp_path, {"token": "new"}, "ca.crt")
    assert await credentials.refresh(seen_generation=credentials.generation)
    assert (credentials.authorization, credentials.due) == ("Bearer new", False)
    assert not await credentials.refresh(seen_generation=credentials.generation), "the same one would be refused again"
