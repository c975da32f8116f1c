"""Each check of `saf-gen validate` as a test, so that fault_list.py can name the checks that catch a fault."""

import pytest

from saf_gen.acceptance.validation import all_validation_checks
from saf_gen.acceptance.validation.runner import run_validation_checks


@pytest.mark.long
@pytest.mark.parametrize("name", all_validation_checks())
def test_a_check_passes_at_its_small_size(tmp_path, name):
    (verdict,) = run_validation_checks([all_validation_checks()[name]], tmp_path, quick=True)
    if verdict.outcome == "skipped":
        pytest.skip(verdict.reason)
    if verdict.outcome == "broken":  # an error, which catches nothing
        raise RuntimeError(verdict.reason)
    assert verdict.outcome == "passed", verdict.comparisons
