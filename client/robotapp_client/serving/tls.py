"""The certificate our port serves, given or made at the start, and the authorities of client certificates.

A given pair is read again when its files change (cert-manager and projected Secrets replace them in place); connections
that stand keep the old one. Without one we make a key and certificate for this process alone, as kube-scheduler does:
it encrypts, but proves nothing, so clients reach us through `kubectl port-forward` or are told the given authority.
"""

import asyncio
import logging
import socket
import ssl
from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

from robotapp_client.api.client import ApiClient
from robotapp_client.api.resources import CONFIGMAPS
from robotapp_client.transport.credentials import load_pair
from robotapp_client.transport.errors import ClientError, LoginError, NotFound

log = logging.getLogger(__name__)

SELF_SIGNED_DAYS: Final = 3650
"""Longer than any process lives: nobody checks the date of a certificate nobody can verify."""
POLL_S: Final = 30.0
AUTHENTICATION: Final = ("kube-system", "extension-apiserver-authentication")
"""Where the API server publishes which authority signs client certificates."""
CLIENT_CA: Final = "client-ca-file"


class TlsPort:
    """The server's context: `load` before the port opens, `run` keeps certificate and authorities up to date.

    `load` changes the context in place, `trust` replaces it: who serves with `trust` asks `current` for each connection.
    """

    def __init__(
        self, certificate: Path | None = None, key: Path | None = None, *, names: tuple[str, ...] = ()
    ) -> None:
        self.context = _make_context()
        self._certificate = certificate
        self._key = key
        self._names = names or ("localhost", socket.gethostname())
        self._pair: tuple[bytes, bytes] | None = None
        self._authorities = ""

    def __repr__(self) -> str:
        return f"<TlsPort {self._certificate or 'self-signed'}>"

    def current(self) -> ssl.SSLContext:
        """Returns the context for a connection that begins now."""
        return self.context

    def load(self) -> None:
        """Take the certificate. Raises `LoginError` naming the files when they cannot be used."""
        if self._certificate is None or self._key is None:
            self._pair = self_signed(self._names)
            load_pair(self.context, *self._pair)
            return
        try:
            pair = (self._certificate.read_bytes(), self._key.read_bytes())
        except OSError as error:
            raise LoginError(f"cannot read {error.filename}: {error.strerror}") from error
        if pair == self._pair:
            return
        try:
            load_pair(
                ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER), *pair
            )  # a half-written pair must not spoil the one in use
            load_pair(self.context, *pair)
        except LoginError as error:
            raise LoginError(f"{self._certificate}, {self._key}: {error}") from error
        self._pair = pair

    def trust(self, authorities: str) -> None:
        """Accept client certificates signed by these PEM authorities and by no others; without one a client may come with a token.

        OpenSSL cannot take an authority out of a context, so each change makes a new one. Sessions of the old one are not resumed.
        """
        if authorities == self._authorities:
            return
        context = _make_context()
        try:
            if authorities:
                context.load_verify_locations(cadata=authorities)
                context.verify_mode = ssl.CERT_OPTIONAL
        except (ssl.SSLError, TypeError, ValueError) as error:  # no text of ASCII characters is a TypeError
            log.warning("the authorities of client certificates stay: %s holds no usable one: %s", CLIENT_CA, error)
            return
        if self._pair is not None:
            load_pair(context, *self._pair)
        self.context, self._authorities = context, authorities

    async def run(self, client: ApiClient) -> None:
        """Follow the files and the API server's authorities until cancelled."""
        while True:
            await self.refresh(client)
            await client.sleep(POLL_S)

    async def refresh(self, client: ApiClient) -> None:
        """Take what files and API server have now. What cannot be used or read stays, each for itself."""
        try:
            if self._certificate is not None:
                self.load()
        except LoginError as error:
            log.warning("the certificate in use stays: %s", error)
        authorities = await client_authorities(client)
        if authorities is not None:
            self.trust(authorities)


def _make_context() -> ssl.SSLContext:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    context.options |= ssl.OP_NO_RENEGOTIATION  # a handshake costs us ten times what it costs a stranger
    return context


async def client_authorities(client: ApiClient) -> str | None:
    """Returns the PEM text of the authorities of client certificates: empty when there is none, None when it cannot be read."""
    namespace, name = AUTHENTICATION
    try:
        found = await client.get(CONFIGMAPS, name, namespace=namespace)
    except NotFound:
        return ""
    except ClientError as error:
        log.debug("the authorities of client certificates stay as they are: %s", error)
        return None
    data: Mapping[str, str] = found.get("data") or {}
    return data.get(CLIENT_CA, "")


def self_signed(names: tuple[str, ...]) -> tuple[bytes, bytes]:
    """PEM certificate and key for these host names."""
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

    key = ec.generate_private_key(ec.SECP256R1())
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, names[0][:64])])
    start = datetime.now(UTC) - timedelta(hours=1)
    made = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(subject)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(start)
        .not_valid_after(start + timedelta(days=SELF_SIGNED_DAYS))
        .add_extension(x509.SubjectAlternativeName([x509.DNSName(name) for name in names]), critical=False)
        .add_extension(x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH]), critical=False)
        .sign(key, hashes.SHA256())
    )
    pem = serialization.Encoding.PEM
    plain = serialization.PrivateFormat.PKCS8
    return made.public_bytes(pem), key.private_bytes(pem, plain, serialization.NoEncryption())


async def loaded(port: TlsPort) -> TlsPort:
    """`load` in a thread: making a key takes a moment."""
    await asyncio.to_thread(port.load)
    return port
