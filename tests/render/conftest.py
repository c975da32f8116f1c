import pytest

from saf_gen.render import backend


@pytest.fixture(params=["scalar", "llvm"])
def every_backend(request):
    """Run a test once with each backend that needs no NVIDIA card."""
    if request.param == "llvm" and not backend.probe_backends().llvm_usable:
        pytest.skip(backend.probe_backends().llvm_description)
    backend.activate_backend(request.param)
