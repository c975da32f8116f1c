import pytest
from written_scenes import ASKED, JIT, needs_llvm

from saf_gen.render import backend
from saf_gen.render.mitsuba_scene import _scene_modules
from saf_gen.scene.scene_folder import find_scene


@pytest.fixture(params=["scalar", pytest.param(JIT, marks=needs_llvm)])
def every_backend(request):
    """Run a test with the variant scalar and with one that traces all positions at once, or with the one asked for."""
    if ASKED and request.param != ASKED:
        pytest.skip(f"--variant {ASKED}")
    backend.activate_backend(request.param)


@pytest.fixture(scope="module")
def family():
    """The scene that draws members at random."""
    backend.activate_backend("scalar")
    return find_scene("assorted_moving")


@pytest.fixture(scope="module")
def modules(family):
    """The modules of its folder and of its kit, by name."""
    with _scene_modules(family):
        import layouts
        import movements
        import scene
        import sight
        import targets
        import textures

        yield {module.__name__: module for module in (layouts, movements, scene, sight, targets, textures)}
