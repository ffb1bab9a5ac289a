from robotapp_scheduler.core.pods.cached_property import CachedProperty


class Counted:
    def __init__(self) -> None:
        self.asked = 0

    @CachedProperty
    def answer(self) -> int:
        """How often it was worked out."""
        self.asked += 1
        return self.asked


def test_a_lazy_answer_is_worked_out_once_per_object() -> None:
    one, two = Counted(), Counted()
    assert (one.answer, one.answer, two.answer) == (1, 1, 1)


def test_a_lazy_answer_keeps_its_name_and_text() -> None:
    assert repr(Counted.answer) == "<CachedProperty answer>"
    assert Counted.answer.__doc__ == "How often it was worked out."
