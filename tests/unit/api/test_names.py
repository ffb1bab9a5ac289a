from robotapp_api.model import names


def test_every_label_and_annotation_is_written_once() -> None:
    values = [str(member) for family in (names.Label, names.Annotation) for member in family]
    assert len(values) == len(set(values))
