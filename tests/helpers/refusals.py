"""Assertions on errors that a user would see."""

from collections.abc import Callable
from typing import Any

import pytest

from saf_gen.errors import BadInput


def refusal(call: Callable[..., Any], *args: Any, **options: Any) -> BadInput:
    """Return the BadInput that a call raises, and assert that its message is one line."""
    with pytest.raises(BadInput) as caught:
        call(*args, **options)
    assert "\n" not in str(caught.value)
    return caught.value


def assert_says(error: BadInput, fragments: str) -> None:
    """Assert that an error message contains each of these fragments, separated by " | ", in any order."""
    missing = [fragment for fragment in fragments.split(" | ") if fragment not in str(error)]
    assert not missing, f"{missing} not in {error}"
