"""The journal of the fleet's tasks: whatever order of requests, reports and deaths, a task is given to one robot and ends once."""

import importlib.util
import tempfile
from pathlib import Path
from types import ModuleType

from hypothesis import given
from hypothesis import strategies as st

SOURCE = Path(__file__).parents[3] / "examples/reference/fleet-ros2/src/reference_fleet/reference_fleet/tasks.py"
TASKS = 5
ROBOTS = st.sampled_from(["one", "two", "three"])
STEPS = st.one_of(
    st.tuples(st.just("give"), ROBOTS),
    st.tuples(st.just("finish"), ROBOTS, st.integers(1, TASKS)),
    st.tuples(st.just("restart"), st.integers(0, 30)),
)
"""A restart comes after so many bytes of one more line, which nobody heard of."""


def load_tasks() -> ModuleType:
    spec = importlib.util.spec_from_file_location("reference_fleet_tasks", SOURCE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


TaskBook = load_tasks().TaskBook


@given(steps=st.lists(STEPS, max_size=60))
def test_a_task_goes_to_one_robot_and_ends_once_whatever_happens(steps: list[tuple[object, ...]]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "tasks.jsonl"
        book = TaskBook(path, TASKS)
        owners: dict[int, object] = {}
        ended: set[int] = set()
        for verb, *arguments in steps:
            if verb == "give":
                (robot,) = arguments
                task = book.give(robot)
                if task is None:
                    assert len(owners) == TASKS
                else:
                    assert owners.setdefault(task, robot) == robot
                    assert task not in ended
            elif verb == "finish":
                robot, task = arguments
                is_end = owners.get(task) == robot and task not in ended
                assert book.finish(task, robot) is is_end
                ended |= {task} if is_end else set()
            else:
                book.close()
                (length,) = arguments
                path.write_text(path.read_text() + '{"task": 1, "given": "nobody"}'[:length])
                book = TaskBook(path, TASKS)
        book.close()


def test_a_robot_that_asks_again_gets_its_own_task_again(tmp_path: Path) -> None:
    book = TaskBook(tmp_path / "tasks.jsonl", TASKS)
    assert [book.give("one"), book.give("one"), book.give("two")] == [1, 1, 2]
    assert book.finish(1, "one")
    assert book.give("one") == 3
    book.close()
