"""Runs the ``scene.py`` of a scene.

Only scenes from :func:`saf_gen.scene.scene_folder.find_scene` may have one.
"""

import importlib.util
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

from saf_gen.core.user_code import user_code
from saf_gen.errors import BadInput
from saf_gen.scene.scene_folder import Scene


def call_scene_script(scene: Scene, function: str, *, default: Any = None) -> Any:
    """Call a function of the scene's script with the scene's parameters, and return its result.

    If the script has no function of this name, return ``default``, unless that is None.

    Raises BadInput, with a one-line message, if the script raises anything.
    """
    script = scene.folder / "scene.py"
    with _scene_modules(scene):
        try:
            with user_code():
                module = _execute(f"saf_gen_scene_{scene.id}", script)
                if default is not None and not hasattr(module, function):
                    return default
                return getattr(module, function)(dict(scene.params))
        except BadInput:
            raise
        except Exception as error:  # the code of a scene may raise anything
            raise BadInput(f"{script} failed: {type(error).__name__}: {error}") from error


def _execute(name: str, file: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, file)
    if spec is None or spec.loader is None:
        raise BadInput(f"{file} cannot be loaded")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@contextmanager
def _scene_modules(scene: Scene) -> Iterator[None]:
    """Let scene.py import its neighbours and its library, and forget all of these modules afterwards.

    Two scenes may thus have different modules of the same name.
    """
    before = dict(sys.modules)
    files = scene.library_files()
    sys.path.insert(0, str(scene.folder))
    try:
        sys.modules.update({name: _execute(name, file) for name, file in files.items()})
        yield
    finally:
        sys.path.remove(str(scene.folder))
        for name in set(sys.modules) - set(before):
            origin = getattr(sys.modules[name], "__file__", None)
            if name in files or (origin and Path(origin).parent == scene.folder):
                del sys.modules[name]
        sys.modules.update({name: before[name] for name in files if name in before})
