"""Third-party plugins by name: what cannot be loaded says why, and where it is looked for."""

import pytest

from robotapp_scheduler.config.plugin_names import UnknownPluginError, load_class


def test_a_module_that_is_not_found_is_answered_with_where_it_is_looked_for() -> None:
    with pytest.raises(UnknownPluginError) as told:
        load_class("no_such_lab.quiet:Quiet")
    assert str(told.value) == (
        "plugin \"no_such_lab.quiet:Quiet\" cannot be loaded: No module named 'no_such_lab'; "
        "the folder it is in belongs on PYTHONPATH"
    )


def test_a_module_that_misses_another_one_names_that_one_alone(
    tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path_factory.mktemp("plugins")
    (folder / "needs_more.py").write_text("import not_installed_here\n")
    monkeypatch.syspath_prepend(folder)
    with pytest.raises(UnknownPluginError, match=r"No module named 'not_installed_here'$"):
        load_class("needs_more:Quiet")
