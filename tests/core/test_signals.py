"""The table of signals, and the check of arrays."""

import numpy as np
import pytest
from refusals import assert_says, refusal

from saf_gen.core.signals import SIGNALS, validate_signal


def test_axes_stand_in_the_order_light_focus_time_row_column():
    order = ["light", "focus", "frame", "row", "col"]
    for signal in SIGNALS.values():
        positions = [order.index(a) for a in signal.axes if a in order]
        if signal.name not in ("spikes", "gain"):  # time is the last axis of packed spikes; gain is a table
            assert positions == sorted(positions), signal.name


def test_values_are_kept_and_the_dtype_is_the_tables():
    out = validate_signal("charge", np.ones((2, 3, 4), dtype=np.float64))
    assert out.dtype == np.float32
    assert out.flags.c_contiguous


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.ones((3, 4)), "charge has shape (3, 4) | 3 axes (focus, row, col)"),
        (np.full((1, 1, 1), np.nan), "charge holds values that are not finite"),
        (np.array([[["a"]]]), "charge has dtype <U1 | numbers"),
    ],
)
def test_an_array_that_does_not_fit_is_refused(array, message):
    assert_says(refusal(validate_signal, "charge", array), message)
