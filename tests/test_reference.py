"""The parts of docs/ that come from the code are up to date."""

import sys

import pytest
from small_dataset import HERE

from saf_gen.core.config import registry
from saf_gen.core.config.field_docs import field_docs

ROOT = HERE.parent


@pytest.fixture(scope="module")
def reference():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "tools"))
        import write_reference

        yield write_reference
        del sys.modules["write_reference"]


@pytest.mark.slow
def test_the_reference_is_what_the_code_says(reference):
    stale = [
        path.relative_to(ROOT).as_posix()
        for path, text in reference.expected_files().items()
        if not path.exists() or path.read_text(encoding="utf-8") != text
    ]
    assert stale == [], "run: python tools/write_reference.py"


@pytest.mark.parametrize("plugin_kind", ["lights", "motions"])
def test_every_key_of_a_light_or_motion_says_its_values_and_its_meaning(plugin_kind):
    for name in registry.names(plugin_kind):
        keys = registry.option_fields(plugin_kind, name)
        docs = field_docs(registry.plugin_class(plugin_kind, name))
        assert set(keys.values()) == set(docs)
        assert all(": " in text for text in docs.values()), name
