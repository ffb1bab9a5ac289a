"""Which container runtimes would leave devices out."""

import pytest

from robotapp_api.values.devices.container_runtime import describe_missing_cdi


@pytest.mark.parametrize(
    "version", ["containerd://1.6.20~ds1", "containerd://v1.5.0", "cri-o://1.22.9", "containerd://0.9.1"]
)
def test_runtimes_before_cdi_are_named_with_the_cure(version: str) -> None:
    assert version in describe_missing_cdi(version)
    assert "upgrade it to containerd 2" in describe_missing_cdi(version)


@pytest.mark.parametrize(
    "version",
    [
        "containerd://2.2.9",
        "containerd://1.7.24",
        "containerd://v10.0.1",
        "cri-o://1.34.0",
        "docker://28.0",
        "kwok",
        "",
        "x://",
    ],
)
def test_nothing_is_said_of_runtimes_that_may_have_it(version: str) -> None:
    assert describe_missing_cdi(version) == ""
