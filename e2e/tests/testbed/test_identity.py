import base64
import csv
import re
from pathlib import Path

import yaml

from robotapp_testbed.control_plane import identity
from robotapp_testbed.control_plane.identity import Identity

CHAIN = "-----BEGIN CERTIFICATE-----\nleaf\n-----END CERTIFICATE-----\n-----BEGIN CERTIFICATE-----\nauthority\n-----END CERTIFICATE-----\n"


def test_operator_and_scheduler_are_the_service_accounts_of_the_chart() -> None:
    standard = identity.standard_identities()
    for name in ("operator", "scheduler"):
        assert standard[name].user == f"system:serviceaccount:robotapp-system:robotapp-{name}"
        assert standard[name].groups == ("system:serviceaccounts", "system:serviceaccounts:robotapp-system")


def test_only_admin_is_above_rbac() -> None:
    masters = [name for name, each in identity.standard_identities().items() if "system:masters" in each.groups]
    assert masters == ["admin"]


def test_every_token_is_different_and_new() -> None:
    tokens = [each.token for _ in range(2) for each in identity.standard_identities().values()]
    assert len(set(tokens)) == len(tokens)


def test_the_token_file_is_the_csv_the_server_reads() -> None:
    text = identity.token_file({"a": Identity("user-a", ("g1", "g2"), "secret"), "b": Identity("user-b", (), "other")})
    assert list(csv.reader(text.splitlines())) == [
        ["secret", "user-a", "a-uid", "g1,g2"],
        ["other", "user-b", "b-uid", ""],
    ]


def test_a_kubeconfig_is_complete_in_itself(tmp_path: Path) -> None:
    (tmp_path / "ca.crt").write_text("certificate")
    text = identity.kubeconfig(
        Identity("user", (), "secret"), server_url="https://127.0.0.1:1", ca_file=tmp_path / "ca.crt"
    )
    config = yaml.safe_load(text)
    assert config["current-context"] == config["contexts"][0]["name"]
    assert config["contexts"][0]["context"]["cluster"] == config["clusters"][0]["name"]
    assert config["contexts"][0]["context"]["user"] == config["users"][0]["name"]
    assert base64.b64decode(config["clusters"][0]["cluster"]["certificate-authority-data"]) == b"certificate"
    assert config["users"][0]["user"] == {"token": "secret"}


def test_the_authority_is_the_last_certificate_of_the_chain() -> None:
    assert identity.last_certificate(CHAIN) == "-----BEGIN CERTIFICATE-----\nauthority\n-----END CERTIFICATE-----\n"


def test_signing_keys_are_p256_keys_and_never_the_same() -> None:
    first, second = identity.signing_key(), identity.signing_key()
    assert first != second
    match = re.fullmatch(r"-----BEGIN EC PRIVATE KEY-----\n(.+)\n-----END EC PRIVATE KEY-----\n", first)
    assert match
    key = base64.b64decode(match[1])
    assert len(key) == key[1] + 2
    assert key[2:7] == b"\x02\x01\x01\x04\x20", "version 1, then the 32 bytes of the scalar"
    assert 0 < int.from_bytes(key[7:39], "big") < identity._P256_ORDER
    assert key.endswith(bytes.fromhex("06082a8648ce3d030107"))
