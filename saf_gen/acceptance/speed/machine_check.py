"""Facts about this machine that matter for rendering: backend, LLVM, graphics card, cores, memory, versions."""

import os
import platform

from saf_gen.core.cores import usable_cores
from saf_gen.core.extras import installed_version
from saf_gen.errors import BadInput
from saf_gen.scene.trusted_folders import all_trusted

PACKAGES = ("mitsuba", "drjit", "numpy", "numba", "scipy", "h5py", "isal", "OpenEXR", "matplotlib")


def describe_machine_to_bench() -> tuple[dict[str, str], list[str]]:
    """Return facts about this machine by name, and advice on what to install, without rendering anything.

    If there is no renderer, this is one of the facts.
    """
    facts: dict[str, str] = {}
    advice: list[str] = []
    try:
        from saf_gen.render import backend
    except BadInput as error:
        facts["variant"] = f"none: {error.problem}; streams can still be evaluated"
        advice.append(f"to render: {error.hint}")
    else:
        found = backend.probe_backends()
        facts["variant"] = backend.choose_backend("auto", found)
        facts["LLVM"] = found.llvm_description
        facts["NVIDIA card"] = "usable" if found.cuda else "none that Mitsuba can use"
        if not found.llvm_usable and not found.cuda:
            advice.append(f"to be faster: {backend.ADVICE}")
    facts["cores"] = f"{usable_cores()} usable of {os.cpu_count()}"
    facts["memory"] = f"{os.sysconf('SC_PAGE_SIZE') * os.sysconf('SC_PHYS_PAGES') / 2**30:.1f} GiB"
    facts["system"] = f"{platform.system()} {platform.release()} {platform.machine()}"
    facts["scenes of yours"] = ", ".join(str(folder) for folder in all_trusted()) or "none registered"
    facts["Python"] = platform.python_version()
    for name in PACKAGES:
        facts[name] = installed_version(name)
    return facts, advice
