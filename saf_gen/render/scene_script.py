"""Runs a scene's own ``scene.py``. Only :func:`saf_gen.scene.scene_folder.find_scene` gives scenes that may
have one."""

import importlib.util
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from saf_gen.errors import BadInput
from saf_gen.scene.scene_folder import Scene

__all__ = ["call_script"]


def call_script(scene: Scene, function: str, absent: Any = None) -> Any:
    """What a function of the folder's script gives for the parameters; ``absent`` where it has none."""
    script = scene.folder / "scene.py"
    spec = importlib.util.spec_from_file_location(f"saf_gen_scene_{scene.id}", script)
    if spec is None or spec.loader is None:
        raise BadInput(f"{script} cannot be loaded")
    module = importlib.util.module_from_spec(spec)
    with _on_path(scene.folder):
        try:
            spec.loader.exec_module(module)
            if absent is not None and not hasattr(module, function):
                return absent
            return getattr(module, function)(dict(scene.params))
        except BadInput:
            raise
        except Exception as error:  # a scene is anybody's code: whatever it raises is told in one line
            raise BadInput(f"{script} failed: {type(error).__name__}: {error}") from error


@contextmanager
def _on_path(folder: Path) -> Iterator[None]:
    """Lets scene.py import its neighbours, and forgets them after, so that two scenes never mix."""
    before = set(sys.modules)
    sys.path.insert(0, str(folder))
    try:
        yield
    finally:
        sys.path.remove(str(folder))
        for name in set(sys.modules) - before:
            origin = getattr(sys.modules[name], "__file__", None)
            if origin and Path(origin).parent == folder:
                del sys.modules[name]
