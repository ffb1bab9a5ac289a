"""The generated files: up to date, complete, stable and harmless."""

import json
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import yaml

from robotapp_api.model.app.robotapp import RobotApp
from robotapp_api.schema import crd, vendor
from robotapp_api.schema.__main__ import ROOT, check, write
from robotapp_api.schema.output import chart_template, generate, to_yaml


@cache
def files() -> dict[Path, str]:
    """What is generated; a second of work, which collecting the tests need not wait for."""
    return generate()


def nodes(schema: dict[str, Any], path: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    yield path, schema
    for key, member in schema.get("properties", {}).items():
        yield from nodes(member, f"{path}.{key}")
    for key in ("items", "additionalProperties"):
        if key in schema:
            yield from nodes(schema[key], path + "[]")


def test_the_repository_holds_what_the_models_say() -> None:
    assert check(ROOT, files()) == []


def test_generation_is_stable() -> None:
    assert generate() == files()


def test_a_changed_or_missing_file_is_named_with_its_first_difference(tmp_path: Path) -> None:
    write(tmp_path, files())
    assert check(tmp_path, files()) == []
    pool = tmp_path / "crds" / "domainpools.yaml"
    pool.write_text(pool.read_text().replace("scope: Cluster", "scope: Namespaced", 1))
    (tmp_path / "docs" / "names.md").unlink()
    assert [problem.partition(" is out of date")[0] for problem in check(tmp_path, files())] == [
        "crds/domainpools.yaml",
        "docs/names.md",
    ]
    assert "scope: Namespaced" in check(tmp_path, files())[0]


def test_a_client_can_apply_the_definition_of_an_app_without_the_server() -> None:
    """Client-side apply keeps a copy in an annotation, and all annotations together may have 256 KiB."""
    compact = json.dumps(
        yaml.safe_load(files()[Path("crds/robotapps.yaml")]), separators=(",", ":"), ensure_ascii=False
    )
    assert len(compact.encode()) <= 256 * 1024


def test_yaml_has_no_anchors_and_reads_back() -> None:
    for path, text in files().items():
        if path.parts[0] == "crds":
            assert not re.search(r"(: |- )[&*][a-z]", text)
            assert yaml.safe_load(text)["kind"] == "CustomResourceDefinition"


def test_the_chart_installs_and_keeps_the_definitions_as_asked() -> None:
    text = chart_template({"metadata": {"name": "things.robotics.io"}, "spec": {}})
    assert text.splitlines()[1:] == [
        "{{- if .Values.crds.enabled }}",
        "metadata:",
        "  name: things.robotics.io",
        "  {{- if .Values.crds.keep }}",
        "  annotations:",
        "    helm.sh/resource-policy: keep",
        "  {{- end }}",
        "spec: {}",
        "{{- end }}",
    ]
    with pytest.raises(ValueError, match="Helm would read"):
        chart_template({"metadata": {"name": "x"}, "spec": "{{ }}"})


def test_shared_parts_are_written_out() -> None:
    part = {"a": 1}
    assert to_yaml({"x": part, "y": part}) == "x:\n  a: 1\ny:\n  a: 1\n"


@pytest.mark.parametrize("model", crd.KINDS, ids=lambda model: model.__name__)
def test_every_root_has_its_definition_and_status(model: Any) -> None:
    version = crd.definition(model)["spec"]["versions"][0]
    assert version["subresources"] == {"status": {}}
    paths = {path for path, _ in nodes(version["schema"]["openAPIV3Schema"])}
    for column in crd.info(model).columns:
        assert column.path in paths or column.path.startswith(".metadata."), column
    assert set(crd.info(model).selectable) <= paths


def test_keys_of_keyed_lists_are_required_or_have_a_default() -> None:
    for model in crd.KINDS:
        for path, node in nodes(crd.schema_of(model)):
            items = node.get("items", {})
            for key in node.get("x-kubernetes-list-map-keys", ()):
                assert key in items.get("required", ()) or "default" in items["properties"][key], f"{path}.{key}"


def test_an_app_has_no_field_that_would_pass_the_scheduler_or_the_policies_by() -> None:
    paths = [path for path, _ in nodes(crd.schema_of(RobotApp))]
    withheld = {"hostIP", "hostUsers", "ephemeral", "iscsi", "flexVolume", "affinity", "serviceAccount", "priority"}
    assert [path for path in paths if path.split(".")[-1] in withheld] == []
    assert [path for path in paths if path.endswith("resources.claims")] == []


def test_core_defaults_that_restate_absence_are_dropped() -> None:
    fields = json.loads(vendor.FILE.read_text())["fields"]
    defaults = {node["default"] for field in fields.values() for _, node in nodes(field) if "default" in node}
    assert defaults == {"TCP"}


def test_the_bridge_ships_the_schema_of_a_robotapp() -> None:
    shipped = json.loads(files()[Path("rigel_bridge/rigel_bridge/data/robotapp.schema.json")])
    assert shipped == crd.schema_of(RobotApp)


def test_the_pages_name_every_field_and_every_reason() -> None:
    page, names = files()[Path("docs/api.md")], files()[Path("docs/names.md")]
    for text in ("`spec.edges[].latency.budget` *", "`spec.components[].env[]`", "`30ms`", "## NodeTelemetry"):
        assert text in page
    for text in ("`robotics.io/app-uid`", "`DomainExhausted`", "`DeviceBusy`"):
        assert text in names
