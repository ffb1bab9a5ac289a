"""YAML with places: what kubectl would read, where it stands, and sentences for what nobody can read."""

import json

import pytest
import yaml

from robotapp_cli.lint.findings import Place, shown, steps
from robotapp_cli.lint.linter import lint
from robotapp_cli.lint.reading import DEEPEST, MOST_ALIASES, MOST_TEXT, Document, UnreadableError, read, text_of
from robotapp_cli.lint.scalars import resolved

TEXT = """\
kind: RobotApp   # a comment
spec:
  components:
  - name: a
    image: "b"
  - {name: c, image: d}
"""


def only(text: str) -> Document:
    (found,) = read(text_of(text.encode()))
    return found


def refused(data: bytes) -> tuple[Place, str]:
    with pytest.raises(UnreadableError) as error:
        list(read(text_of(data)))
    return error.value.place, error.value.message


class TestPlaces:
    @pytest.mark.parametrize(
        ("path", "place"),
        [
            ((), (1, 1)),
            (("kind",), (1, 7)),
            (("spec",), (2, 1)),
            (("spec", "components"), (3, 3)),
            (("spec", "components", 0), (4, 5)),
            (("spec", "components", 0, "image"), (5, 12)),
            (("spec", "components", 1, "image"), (6, 22)),
        ],
    )
    def test_values_stand_where_they_begin_and_what_holds_others_at_its_name(
        self, path: tuple[str | int, ...], place: tuple[int, int]
    ) -> None:
        assert only(TEXT).root.place_of(path) == place

    def test_a_path_that_is_not_written_points_at_what_is_nearest_around_it(self) -> None:
        root = only(TEXT).root
        assert root.place_of(("spec", "ros", "distro")) == root.place_of(("spec",)) == (2, 1)
        assert root.place_of(("spec", "components", 7, "name")) == (3, 3)
        assert root.place_of(("spec", "components", 0, "env")) == (4, 5)

    def test_the_name_of_a_field_can_be_pointed_at(self) -> None:
        assert only(TEXT).root.place_of(("spec", "components", 0, "image"), at_key=True) == (5, 5)

    def test_what_an_alias_repeats_stands_where_it_was_written(self) -> None:
        root = only("a: &x {b: [1, 2]}\nc: *x\nd:\n  <<: *x\n  e: 1\n").root
        assert root.value == {"a": {"b": [1, 2]}, "c": {"b": [1, 2]}, "d": {"e": 1, "b": [1, 2]}}
        assert root.place_of(("c", "b", 1)) == root.place_of(("d", "b", 1)) == (1, 15)

    def test_documents_come_one_by_one_and_empty_ones_are_left_out(self) -> None:
        found = list(read("---\n---\na: 1\n---\n# nothing\n---\nb: 2\n"))
        assert [each.root.value for each in found] == [{"a": 1}, {"b": 2}]
        assert found[1].root.place_of(("b",)) == (7, 4)

    @pytest.mark.parametrize(
        ("path", "text"),
        [
            (("spec", "components", 0, "env"), "spec.components[0].env"),
            (("a", "nvidia.com/gpu"), 'a["nvidia.com/gpu"]'),
            (("a", 'q"\\'), 'a["q\\"\\\\"]'),
            ((), ""),
        ],
    )
    def test_a_path_can_be_written_and_read_again(self, path: tuple[str | int, ...], text: str) -> None:
        assert shown(path) == text
        assert steps(text) == path


class TestScalars:
    @pytest.mark.parametrize(
        ("text", "value"),
        [
            ("yes", True), ("y", True), ("On", True), ("off", False), ("N", False), ("~", None), ("", None),
            ("0x10", 16), ("010", 8), ("0b11", 3), ("-7", -7), ("1_000", 1000), ("08", 8), ("1e3", 1000), ("2.0", 2),
            ("0.5", 0.5), (".5", 0.5), ("12:30", "12:30"), ("2026-01-01", "2026-01-01"), ("1e999", "1e999"),
            ("-", "-"), ("8086:0b3a", "8086:0b3a"), ("9" * 70, "9" * 70),
        ],
    )  # fmt: skip
    def test_a_plain_scalar_is_what_it_is_to_kubectl(self, text: str, value: object) -> None:
        found = resolved(text)
        assert (found, type(found)) == (value, type(value))

    def test_quotes_and_tags_decide_before_anything_else(self) -> None:
        assert only("- \"7\"\n- 'yes'\n- !!str 7\n- !!int 7\n- |-\n  7\n").root.value == ["7", "yes", "7", 7, "7"]

    def test_names_of_fields_become_text(self) -> None:
        assert only("{7: a, on: b, 0.5: c}").root.value == {"7": "a", "true": "b", "0.5": "c"}


class TestProblems:
    """The text can be read, but not everything in it means something."""

    @pytest.mark.parametrize(
        ("text", "place", "message"),
        [
            ("a: 1\nb: 2\na: 3\n", (3, 1), "a is written twice, here and in line 1; one of the two would be lost"),
            ("a: .inf", (1, 4), ".inf is no JSON number; write a number, or put it in quotes"),
            ("a: !!binary aGk=", (1, 4), "!!binary is nothing JSON has; remove the tag"),
            ("a: !!set {b}", (1, 4), "!!set is nothing JSON has; remove the tag"),
            ("? [a]\n: b", (1, 3), "the name of a field must be text"),
            ("a: {b: {{ .Values.b }}}", (1, 9), "the name of a field must be text; a Helm template is checked as it is rendered"),
            ("a: {<<: 3}", (1, 9), "<< takes a mapping or a list of mappings"),
        ],
    )  # fmt: skip
    def test_single_places_are_named_and_the_rest_is_read(self, text: str, place: Place, message: str) -> None:
        ((found, said),) = only(text).problems
        assert found == place
        assert said.startswith(message)


class TestJson:
    @pytest.mark.parametrize(
        ("data", "value"),
        [
            (rb'{"a": "\ud83d\ude00!"}', "\U0001f600!"),
            (rb' {"a": "\\\uD83D\uDE00"}', "\\\U0001f600"),
            (rb'{"a": "\\ud83d\\ude00"}', "\\ud83d\\ude00"),
            (rb'{"a": "\u00e4"}', "\u00e4"),
        ],
    )
    def test_a_character_in_two_escapes_is_what_kubectl_reads(self, data: bytes, value: str) -> None:
        assert json.loads(data)["a"] == value
        (found,) = read(text_of(data))
        assert found.root.value["a"] == value


class TestUnreadable:
    @pytest.mark.parametrize(
        ("data", "place", "message"),
        [
            (b"a:\n\t- b", (2, 1), "a tab stands where YAML wants spaces; indent with spaces"),
            (b"a: @b", (1, 4), "'@' cannot begin a value; put the value in quotes"),
            (b"a: b: c", (1, 5), "put text that holds a colon in quotes"),
            (b"a: [b\n", (2, 1), "close the bracket or brace"),
            (b"a: 'b\n", (2, 1), "close the quotes"),
            (b"a: 1\n  b: 2\n", (2, 4), "indent the line like its neighbours"),
            (b"a: 1\nb: \xff\n", (2, 4), "this is no UTF-8 text"),
            (b"a: 1\nb: \x01", (2, 4), "the control character '\\x01' is not allowed in YAML"),
            (b"a: 1\n}\n", (2, 1), "the } closes nothing; remove it, or write the { that it closes"),
            (b"a: {b: c}}\nd: e\n", (1, 10), "the } closes nothing"),
            (b"- a\n]\n", (2, 1), "the ] closes nothing; remove it, or write the [ that it closes"),
            (b"}\n", (1, 1), "the } closes nothing"),
            (b'{"a": 1}}', (1, 9), "the } closes nothing"),
            (b"a: [1, 2}\n", (1, 9), "close the bracket or brace"),
            (
                b"a: b\n{{- if .Values.c }}\nc: d\n{{- end }}\n",
                (3, 1),
                "; a Helm template is checked as it is rendered: helm template",
            ),
            (b"a:\n  b: {{ .Values.b }}-x\nc: d\n", (2, 21), "; a Helm template is checked as it is rendered"),
            (b'a:\n  {{- include "b" . | nindent 2 }}\n', (2, 5), "; a Helm template is checked as it is rendered"),
            (b"a: 1\xc2\x85\xc2\x85}", (3, 1), "indent the line like its neighbours"),
            (b'{"a": "\\ud83d"}', (1, 10), "write the character itself"),
            (b'a: "\\ud83d\\ude00"', (1, 7), "write the character itself"),
            (b"a: *b", (1, 4), "*b names nothing that is complete here"),
            (b"a: &a [*a]", (1, 8), "*a names nothing that is complete here"),
            (b"[" * 100_000, (1, DEEPEST + 1), f"this is nested deeper than {DEEPEST} levels"),
            (b"- a\n" * 200_000, (100_000, 3), "a document of more than 100000 values is not checked"),
            (b"#" * (MOST_TEXT + 1), (1, 1), "the file is larger than 4 MiB"),
            (b"a: &a 1\nb: [" + b"*a," * (MOST_ALIASES + 1) + b"]", (2, 197), "more than 64 aliases are not followed"),
        ],
        ids=lambda value: value[:12].decode(errors="replace").strip() if isinstance(value, bytes) else "",
    )
    def test_one_sentence_says_why_and_what_to_do(self, data: bytes, place: tuple[int, int], message: str) -> None:
        found, said = refused(data)
        assert message in said
        assert found == place
        assert "\n" not in said

    @pytest.mark.parametrize("inner", ["[{0}]", "{{p: [{0}], q: [{0}]}}"])
    def test_a_few_lines_that_name_a_billion_values_are_refused(self, inner: str) -> None:
        lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
        lines += [f"a{at}: &a{at} " + inner.format(", ".join([f"*a{at - 1}"] * 3)) for at in range(1, 15)]
        assert "more than 100000 values" in refused("\n".join(lines).encode())[1]

    def test_merged_fields_are_counted_too(self) -> None:
        fields = ", ".join(f"k{at}: v" for at in range(20_000))
        text = f"a: &a {{{fields}}}\nb: {{<<: *a}}\nc: {{<<: *a}}\nd: {{<<: *a}}\n"
        assert "more than 100000 values" in refused(text.encode())[1]

    def test_aliases_cannot_nest_deeper_than_the_limit(self) -> None:
        deep = "[" * 60 + "]" * 60
        text = f"a: &a {deep}\nb: " + "[" * 60 + "*a" + "]" * 60
        assert "nested deeper" in refused(text.encode())[1]

    def test_documents_before_the_unreadable_one_are_checked(self) -> None:
        report = lint(b"kind: RobotApp\n---\na: [")
        assert [each.reason for each in report.findings][-1] == "BadYaml"
        assert report.checked["RobotApp"] == 1

    def test_a_byte_order_mark_and_windows_line_ends_are_no_mistake(self) -> None:
        data = "﻿a: 1\r\nb: {c: 2}\r\n".encode()
        (found,) = read(text_of(data))
        assert found.root.value == yaml.safe_load(data) == {"a": 1, "b": {"c": 2}}
