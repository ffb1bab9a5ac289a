"""Pages are taken apart into files, commands and what a reader sees."""

from campaigns.nodes.walkthrough import Command, File, not_seen, steps

PAGE = """\
Save this as `a.yaml`:
```yaml
kind: A
```
```
first
second --now
```
```console
$ kubectl get a
NAME   AGE
one    4s
$ kubectl delete a one
```
"""


def test_files_and_commands_come_in_the_order_of_the_page() -> None:
    assert list(steps(PAGE)) == [
        File("a.yaml", "kind: A\n"),
        Command("first"),
        Command("second --now"),
        Command("kubectl get a", ("NAME   AGE", "one    4s")),
        Command("kubectl delete a one"),
    ]


def test_numbers_ages_and_widths_may_differ_and_words_may_not() -> None:
    assert not_seen(["one   4s   61"], "NAME\none 1m2s    7\n") == []
    assert not_seen(["one   4s"], "two 4s") == ["one   4s"]


def test_three_dots_stand_for_any_text_on_the_line() -> None:
    assert not_seen(["driver   …", "edge … here"], "driver amr-07, because\nedge of 2 s here") == []
    assert not_seen(["driver   …"], "planner   edge-1") == ["driver   …"]
