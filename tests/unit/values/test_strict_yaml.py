"""YAML of strangers: what is refused, and that a small text costs little."""

import time

import pytest
import yaml

from robotapp_api.values.strict_yaml import DEEPEST, loads

DOUBLED = "l0: &l0 [a, b]\n" + "".join(f"l{n}: &l{n} [*l{n - 1}, *l{n - 1}]\n" for n in range(1, 60))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (f"{DOUBLED}? *l59\n: 1\n", "a key is a list or a map"),
        ("? {a: 1}\n: 1\n", "a key is a list or a map"),
        (DOUBLED, "more than 100000 values"),
        ("a: &a [*a]\n", "values, or one that holds itself"),
        (f"{'[' * 100_000}", f"nested deeper than {DEEPEST} levels"),
        (f"{'- ' * 100_000}", f"nested deeper than {DEEPEST} levels"),
        ("\n".join(f"{' ' * n}a:" for n in range(200)), "line 101: nested deeper"),
        (f"a: 1{':1' * 100_000}", "line 1: a number of 200001 characters"),
        (f"a: {'1' * 5000}", "a number of 5000 characters; write it in quotes"),
        ("a: 1\na: 2\n", 'line 2: key "a" already set'),
        ("a:\n- {b\n", "^line 3, column 1: while parsing a flow mapping, did not find expected"),
    ],
    ids=range(11),
)
def test_a_text_that_would_take_long_or_lose_something_is_refused_at_once(text: str, said: str) -> None:
    began_s = time.process_time()
    for _ in range(300):  # the same machine's own work, to compare with
        yaml.load("[[[a, 1, {b: c}]]]", Loader=yaml.CSafeLoader)
    unit_s, began_s = time.process_time() - began_s, time.process_time()
    with pytest.raises(yaml.YAMLError, match=said):
        loads(text)
    assert time.process_time() - began_s < 50 * unit_s


def test_what_people_write_is_read() -> None:
    nested = "[" * (DEEPEST - 1) + "1" + "]" * (DEEPEST - 1)
    assert loads("/**:\n  ros__parameters: {rate: 20.0, on: true, '007': a}\n")
    assert loads(f"a: {nested}")
    assert loads("") is None
    assert loads(f'a: "{"1" * 5000}"') == {"a": "1" * 5000}
