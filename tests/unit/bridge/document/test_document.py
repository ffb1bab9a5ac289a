"""Reading YAML within bounds, with lines."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigel_bridge.document.failures import BridgeError, Exit
from rigel_bridge.document.tree import MAX_BYTES, MAX_DEPTH, Node, parse
from rigel_bridge.source import read_bytes


def failure(data: bytes | str) -> BridgeError:
    with pytest.raises(BridgeError) as caught:
        parse(data if isinstance(data, bytes) else data.encode(), "Rigelfile")
    return caught.value


def child(text: str, key: str) -> Node:
    return parse(text.encode(), "Rigelfile").mapping()[key]


def test_every_value_knows_its_line_and_path() -> None:
    node = child("a: 1\nb:\n  - x\n  - {c: y}\n", "b").sequence()[1].mapping()["c"]
    assert (str(node.place), node.path, node.value) == ("Rigelfile:4", "b[1].c", "y")


def test_a_block_stands_where_its_key_stands() -> None:
    assert str(child("a: 1\nb:\n\n  c: y\n", "b").place) == "Rigelfile:2"


def test_an_alias_chain_is_refused_before_anything_is_built(monkeypatch: pytest.MonkeyPatch) -> None:
    levels = "".join(f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]\n" for n in range(1, 9))
    monkeypatch.setattr("yaml.compose", None)
    error = failure("a0: &a0 [x]\n" + levels)
    assert str(error) == "Rigelfile:2: alias *a0 is not allowed: write the value out"


def test_deep_nesting_is_refused() -> None:
    assert f"nested deeper than {MAX_DEPTH} levels" in str(failure("a: " + "[" * 500 + "]" * 500))
    parse(("a: " + "[" * (MAX_DEPTH - 1) + "]" * (MAX_DEPTH - 1)).encode(), "Rigelfile")


def test_a_large_file_is_refused_unread() -> None:
    error = failure(b"a: " + b"x" * MAX_BYTES)
    assert "larger than 256 KiB" in str(error)
    assert error.code is Exit.UNREADABLE


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: 1\nb: 2\na: 3\n", "Rigelfile:3: a: the key is there twice"),
        (
            "a: !!python/object/apply:os.system [ls]\n",
            "Rigelfile:1: a: tag !!python/object/apply:os.system is not allowed",
        ),
        ("a: !secret x\n", "Rigelfile:1: a: tag !secret is not allowed"),
        ("a: 1\n---\nb: 2\n", "Rigelfile:2: holds a second document: a Rigelfile is one"),
        ("a: {<<: {b: 1}}\n", "Rigelfile:1: a: keys are plain words"),
        ("? [a, b]\n: 1\n", "Rigelfile:1: the document: keys are plain words"),
        ("a: {b: {{ c }}}\n", 'Rigelfile:1: a.b: a value that begins with {{ needs quotes: "{{ name }}"'),
        (
            "a: {{ c }}:1\n",
            'Rigelfile:1: is not YAML: did not find expected key; put a value that begins with {{ in quotes: "{{ name }}"',
        ),
        ("", "Rigelfile: is empty; a Rigelfile has packages, or application and jobs (docs/rigel-bridge.md)"),
        (
            "a: [1, 2\n",
            "Rigelfile:2: is not YAML: did not find expected ',' or ']'; look at the indentation and the brackets of the lines above",
        ),
        (
            "a:\n\t- b\n",
            "Rigelfile:2: is not YAML: found character that cannot start any token; the line is indented with a tab: YAML takes spaces only",
        ),
        (
            "a: b: c\n",
            'Rigelfile:1: is not YAML: mapping values are not allowed in this context; put a value that holds ": " in quotes, or look for a line above that is indented otherwise',
        ),
        ("a: 1\nb: \x01\n", "Rigelfile:2: holds a control character: a Rigelfile is plain text"),
    ],
)
def test_what_is_not_accepted_is_named_with_its_line(text: str, message: str) -> None:
    error = failure(text)
    assert str(error) == message
    assert error.code is Exit.SYNTAX


def test_a_tuple_of_python_is_a_list() -> None:
    assert [node.value for node in child("a: !!python/tuple [5000, x]\n", "a").sequence()] == [5000, "x"]


def test_text_in_another_encoding_is_refused_with_its_line() -> None:
    assert str(failure("a: 1\nb: ü\n".encode("latin-1"))) == "Rigelfile:2: is not UTF-8 text"


def test_windows_lines_and_a_byte_order_mark_are_fine() -> None:
    assert parse(b"\xef\xbb\xbfa: 1\r\nb: x\r\n", "Rigelfile").mapping()["b"].value == "x"


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("yes", True),
        ("off", False),
        ("12", 12),
        ("0x1f", 31),
        ("1.5", 1.5),
        ("~", None),
        ("1:30", "1:30"),
        ("2026-01-02", "2026-01-02"),
        ("'no'", "no"),
    ],
)
def test_scalars_are_read_as_typed_or_as_yaml_means_them(text: str, value: object) -> None:
    node = child(f"a: {text}\n", "a")
    assert node.value == value
    assert node.raw == text.strip("'")


def test_a_missing_file_is_said_in_words(tmp_path: Path) -> None:
    with pytest.raises(BridgeError, match="cannot be read: No such file or directory"):
        read_bytes(tmp_path / "Rigelfile")


def test_a_folder_is_told_with_the_file_that_is_meant(tmp_path: Path) -> None:
    with pytest.raises(BridgeError, match=r"cannot be read: Is a directory; give the file in it$"):
        read_bytes(tmp_path)
    (tmp_path / "Rigelfile").write_text("a: 1\n")
    with pytest.raises(BridgeError, match=r"; give the file, such as .*/Rigelfile$"):
        read_bytes(tmp_path)


def outcome(data: bytes) -> str:
    try:
        parse(data, "Rigelfile")
    except BridgeError as error:
        return str(error)
    return "Rigelfile"


@given(st.binary(max_size=300))
def test_any_bytes_give_a_tree_or_one_error(data: bytes) -> None:
    assert outcome(data).startswith("Rigelfile")


@given(st.text(alphabet="{}[]&*!|>'\"-: \n\tab01<,?%@`#", max_size=80))
def test_any_punctuation_gives_a_tree_or_one_line(text: str) -> None:
    assert "\n" not in outcome(text.encode())
