import pytest
from written_scenes import ASKED, JIT, needs_llvm

from saf_gen.render import backend


@pytest.fixture(params=["scalar", pytest.param(JIT, marks=needs_llvm)])
def every_backend(request):
    """Run a test with the variant scalar and with one that traces all positions at once, or with the one asked for."""
    if ASKED and request.param != ASKED:
        pytest.skip(f"--variant {ASKED}")
    backend.activate_backend(request.param)
