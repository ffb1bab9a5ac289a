"""Certificates: an authority made on the spot, and what it signs for a day."""

import ipaddress
from datetime import UTC, datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

PEM = serialization.Encoding.PEM


class Authority:
    """Signs certificates of servers (by host name or address) and of users (by name and groups)."""

    def __init__(self, name: str = "testbed authority") -> None:
        self._key = ec.generate_private_key(ec.SECP256R1())
        self._name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
        built = self._builder(self._name, self._key).add_extension(x509.BasicConstraints(ca=True, path_length=0), True)
        self.pem = built.sign(self._key, hashes.SHA256()).public_bytes(PEM).decode()

    def user(self, folder: Path, name: str, *groups: str) -> tuple[Path, Path]:
        """Files of a client certificate and its key."""
        parts = [x509.NameAttribute(NameOID.ORGANIZATION_NAME, group) for group in groups]
        subject = x509.Name([*parts, x509.NameAttribute(NameOID.COMMON_NAME, name)])
        return self._issue(folder, subject, ExtendedKeyUsageOID.CLIENT_AUTH)

    def server(self, folder: Path, host: str) -> tuple[Path, Path]:
        """Files of a serving certificate and its key; `host` is a name or an IP address."""
        subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, host)])
        return self._issue(folder, subject, ExtendedKeyUsageOID.SERVER_AUTH, host)

    def _builder(self, subject: x509.Name, key: ec.EllipticCurvePrivateKey) -> x509.CertificateBuilder:
        now = datetime.now(UTC)
        return (
            x509.CertificateBuilder()
            .subject_name(subject)
            .issuer_name(self._name)
            .public_key(key.public_key())
            .serial_number(x509.random_serial_number())
            .not_valid_before(now - timedelta(hours=1))
            .not_valid_after(now + timedelta(days=1))
        )

    def _issue(
        self, folder: Path, subject: x509.Name, usage: x509.ObjectIdentifier, host: str = ""
    ) -> tuple[Path, Path]:
        key = ec.generate_private_key(ec.SECP256R1())
        built = self._builder(subject, key).add_extension(x509.ExtendedKeyUsage([usage]), critical=False)
        if host:
            built = built.add_extension(x509.SubjectAlternativeName([_general_name(host)]), critical=False)
        folder.mkdir(parents=True, exist_ok=True)
        certificate, private = folder / "tls.crt", folder / "tls.key"
        certificate.write_bytes(built.sign(self._key, hashes.SHA256()).public_bytes(PEM))
        plain = serialization.NoEncryption()
        private.write_bytes(key.private_bytes(PEM, serialization.PrivateFormat.PKCS8, plain))
        return certificate, private


def _general_name(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)
