import pytest
from tests.support.wrong_input import configurations

from robotapp_scheduler.config.load import parse
from robotapp_scheduler.plugins import registry
from robotapp_scheduler.shell.config.reload import document


@pytest.mark.parametrize("what", configurations.ACCEPTED)
def test_what_configz_shows_is_a_configuration_that_means_the_same(what: str) -> None:
    used = configurations.config(registry.catalogue(), **configurations.ACCEPTED[what])
    shown = document(used)
    again = parse(shown, catalogue=registry.catalogue())
    assert again.restart_needed(used) == ()
    assert document(again) == shown
    for name, profile_in_use in used.build().items():
        same = again.build()[name]
        assert [loaded.name for loaded in same.filters] == [loaded.name for loaded in profile_in_use.filters]
        assert [(loaded.name, loaded.weight) for loaded in same.scores] == [
            (loaded.name, loaded.weight) for loaded in profile_in_use.scores
        ]
