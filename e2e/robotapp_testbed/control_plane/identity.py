"""Who talks to the API server: users with their groups, tokens, kubeconfig files and the service-account key."""

import base64
import secrets
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import yaml

from robotapp_api.model.names import SYSTEM_NAMESPACE

OPERATOR_ACCOUNT: Final = "robotapp-operator"
SCHEDULER_ACCOUNT: Final = "robotapp-scheduler"
LABELLER_ACCOUNT: Final = "robotapp-labeller"
ADMIN: Final = "admin"

_P256_ORDER = 0xFFFFFFFF00000000FFFFFFFFFFFFFFFFBCE6FAADA7179E84F3B9CAC2FC632551
_P256_OID = bytes.fromhex("06082a8648ce3d030107")


@dataclass(frozen=True, slots=True)
class Identity:
    user: str
    groups: tuple[str, ...] = ()
    token: str = field(default_factory=lambda: secrets.token_hex(16))
    namespace: str = "default"
    """The context's namespace; for a service account its own, where its Lease lives."""


def service_account(name: str, *, namespace: str = SYSTEM_NAMESPACE) -> Identity:
    """The identity a pod with this ServiceAccount has, so RBAC and policies treat a local process like the pod."""
    return Identity(
        user=f"system:serviceaccount:{namespace}:{name}",
        groups=("system:serviceaccounts", f"system:serviceaccounts:{namespace}"),
        namespace=namespace,
    )


def standard_identities() -> dict[str, Identity]:
    """admin may do everything; operator, scheduler and labeller have the chart's rights; tenants have what a test grants them."""
    return {
        ADMIN: Identity(user="admin", groups=("system:masters",)),
        "operator": service_account(OPERATOR_ACCOUNT),
        "scheduler": service_account(SCHEDULER_ACCOUNT),
        "labeller": service_account(LABELLER_ACCOUNT),
        "tenant": Identity(user="tenant", groups=("tenants",)),
        "tenant-b": Identity(user="tenant-b", groups=("tenants",)),
    }


def token_file(identities: Mapping[str, Identity]) -> str:
    """Text for kube-apiserver --token-auth-file."""
    lines = [f'{each.token},{each.user},{name}-uid,"{",".join(each.groups)}"' for name, each in identities.items()]
    return "\n".join(lines) + "\n"


def kubeconfig(identity: Identity, *, server_url: str, ca_file: Path) -> str:
    """A complete kubeconfig; the certificate is embedded, so the file can be copied."""
    authority = base64.b64encode(ca_file.read_bytes()).decode()
    config = {
        "apiVersion": "v1",
        "kind": "Config",
        "clusters": [{"name": "testbed", "cluster": {"server": server_url, "certificate-authority-data": authority}}],
        "users": [{"name": identity.user, "user": {"token": identity.token}}],
        "contexts": [
            {
                "name": "testbed",
                "context": {"cluster": "testbed", "user": identity.user, "namespace": identity.namespace},
            }
        ],
        "current-context": "testbed",
    }
    return yaml.safe_dump(config, sort_keys=False)


def last_certificate(chain: str) -> str:
    """The last certificate of a PEM chain: the authority at its end."""
    begin = "-----BEGIN CERTIFICATE-----"
    return chain[chain.rindex(begin) :]


def signing_key() -> str:
    """A fresh P-256 private key in SEC 1 form (RFC 5915) for signing service-account tokens.

    Written by hand because it is 51 bytes, and neither openssl nor a crypto library must be installed for it.
    """
    scalar = (secrets.randbelow(_P256_ORDER - 1) + 1).to_bytes(32, "big")
    body = b"\x02\x01\x01" + b"\x04\x20" + scalar + b"\xa0" + bytes([len(_P256_OID)]) + _P256_OID
    text = base64.b64encode(b"\x30" + bytes([len(body)]) + body).decode()
    return f"-----BEGIN EC PRIVATE KEY-----\n{text}\n-----END EC PRIVATE KEY-----\n"
