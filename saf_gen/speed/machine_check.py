"""What this machine can do: variant, LLVM, card, cores, memory, versions."""

import os
import platform
from importlib.metadata import PackageNotFoundError, version

from saf_gen.core.cores import usable_cores

__all__ = ["describe_installation"]

PACKAGES = ("mitsuba", "drjit", "numpy", "numba", "scipy", "h5py", "isal", "OpenEXR", "matplotlib")


def describe_installation() -> tuple[dict[str, str], list[str]]:
    """(facts by name, advice on what to install): nothing is rendered, and a missing renderer is a fact."""
    described: dict[str, str] = {}
    advice: list[str] = []
    try:
        from saf_gen.render import backend
    except ImportError as error:
        described["variant"] = f"none: {error}; streams can still be evaluated"
        advice.append("install the renderer: pip install saf-gen")
    else:
        found = backend.probe_backends()
        described["variant"] = backend.choose_backend("auto", found)
        described["LLVM"] = found.llvm_description
        described["NVIDIA card"] = "usable" if found.cuda else "none that Mitsuba can use"
        if not found.llvm_usable and not found.cuda:
            advice.append(backend.ADVICE)
    described["cores"] = f"{usable_cores()} usable of {os.cpu_count()}"
    described["memory"] = f"{os.sysconf('SC_PAGE_SIZE') * os.sysconf('SC_PHYS_PAGES') / 2**30:.1f} GiB"
    described["system"] = f"{platform.system()} {platform.release()} {platform.machine()}"
    described["Python"] = platform.python_version()
    for name in PACKAGES:
        described[name] = _version(name)
    return described, advice


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"
