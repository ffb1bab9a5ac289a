"""The chart's rules and policies are taken by every Kubernetes release it names, and no further release is named."""

import json
import subprocess
from pathlib import Path

import pytest
import yaml
from tests.live.chart.chart import CHART, Object

from campaigns.versions.cel import (
    COMPILED,
    RELEASES,
    compiled,
    compiler,
    errors,
    rendered,
    with_expressions,
    write,
)
from robotapp_testbed.binaries import pins, versions

pytestmark = pytest.mark.live
RAN_LIVE = ("1.35", "1.36", "1.37")
"""Releases that passed `scripts/bench versions`, and the one that all tests run on."""
INSTALLATION = (pins.REPOSITORY / "docs" / "installation.md").read_text()


@pytest.fixture(scope="module")
def program() -> Path:
    return compiler()


def policy(expression: str) -> Object:
    spec = {"validations": [{"expression": expression, "messageExpression": "'size ' + string(size(variables.all))"}]}
    spec |= {"variables": [{"name": "all", "expression": "[1, 2]"}]}
    kind = {"apiVersion": "admissionregistration.k8s.io/v1", "kind": "ValidatingAdmissionPolicy"}
    return {**kind, "metadata": {"name": "p"}, "spec": spec}


@pytest.mark.parametrize("release", RELEASES)
def test_every_expression_compiles_on_every_release_the_chart_names(
    release: str, program: Path, tmp_path: Path
) -> None:
    files = write(rendered(release), tmp_path)
    reports = compiled(program, files, release=release)
    assert {Path(report["file"]).name.partition("-")[0] for report in reports} == set(COMPILED)
    assert all(report["costs"] for report in reports if "ValidatingAdmissionPolicy" in report["file"])
    assert errors(reports) == []


def test_no_object_of_the_chart_has_expressions_of_a_kind_that_is_not_compiled() -> None:
    found = [item["kind"] for item in rendered(RELEASES[0]) if with_expressions(item)]
    assert set(found) == set(COMPILED)


@pytest.mark.parametrize(
    ("expression", "since"),
    [("[[1], [2]].flatten().size() == 2", "1.35"), ("[1, 2].all(i, v, v > i)", "1.33")],
    ids=["flatten", "comprehensions with two variables"],
)
def test_an_expression_of_a_later_release_is_refused_by_earlier_ones(
    expression: str, since: str, program: Path, tmp_path: Path
) -> None:
    """A release takes only what the one before it knew as well, so that a rollback finds nothing it cannot read."""
    (file,) = write([policy(expression)], tmp_path)
    refused = [release for release in RELEASES if errors(compiled(program, [file], release=release))]
    assert refused == list(RELEASES[: RELEASES.index(since)])


def test_a_policy_whose_message_is_no_text_does_not_compile(program: Path, tmp_path: Path) -> None:
    broken = policy("size(variables.all) == 2")
    broken["spec"]["validations"][0]["messageExpression"] = "1"
    (file,) = write([broken], tmp_path)
    (error,) = errors(compiled(program, [file]))
    assert "must evaluate to string" in error


def test_the_chart_refuses_the_release_before_its_oldest_one() -> None:
    chart = yaml.safe_load((CHART / "Chart.yaml").read_text())
    assert chart["kubeVersion"] == f">={RELEASES[0]}.0-0"
    major, minor = RELEASES[0].split(".")
    with pytest.raises(subprocess.CalledProcessError) as refused:
        rendered(f"{major}.{int(minor) - 1}")
    assert "kubeVersion" in refused.value.stderr


def test_the_documentation_lists_every_release_with_what_was_done_on_it() -> None:
    known = {pins.KUBERNETES.rpartition(".")[0].removeprefix("v"): pins.KUBERNETES} | versions.OTHERS
    for release in RELEASES:
        ran = f"ran live ({known[release].removeprefix('v')}), " if release in RAN_LIVE else ""
        assert f"| {release} | {ran}compiles |" in INSTALLATION


def test_the_compiled_files_are_the_rendered_objects(tmp_path: Path) -> None:
    (file,) = write([policy("true"), {"kind": "ConfigMap", "metadata": {"name": "c"}}], tmp_path)
    assert json.loads(file.read_text())["metadata"]["name"] == "p"
