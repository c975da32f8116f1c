"""The choice of Mitsuba's backend: cuda if possible, else llvm, else scalar.

LLVM 15 and 16 abort the process at the first kernel ("cannot select fminimum"), which cannot be caught. The choice is
therefore made from version numbers, without running a kernel.
"""

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numba

from saf_gen.core.cores import check_address_space, usable_cores
from saf_gen.errors import BadInput, unknown

OLDEST_LLVM = 17
MIN_MEMORY = 3 << 30
MITSUBA_VARIANTS = {"cuda": "cuda_ad_mono", "llvm": "llvm_ad_mono", "scalar": "scalar_rgb"}
ADVICE = "install LLVM 17 or newer (Debian, Ubuntu: apt install libllvm19) to render many times faster"


@dataclass(frozen=True)
class BackendProbe:
    """The rendering capabilities of a machine.

    Attributes
    ----------
    llvm : tuple of int or None
        Version of LLVM; None if no library was found.
    cuda : bool
        Whether CUDA can be used.
    """

    llvm: tuple[int, int, int] | None
    cuda: bool

    @property
    def llvm_usable(self) -> bool:
        return self.llvm is not None and self.llvm[0] >= OLDEST_LLVM

    @property
    def llvm_description(self) -> str:
        if self.llvm is None:
            return "no LLVM library was found"
        version = ".".join(str(n) for n in self.llvm)
        if self.llvm_usable:
            return f"LLVM {version}"
        return f"LLVM {version} is too old: Mitsuba needs {OLDEST_LLVM} or newer and would abort"


def probe_backends() -> BackendProbe:
    """Return the version of LLVM and whether CUDA is available on this machine, without starting a kernel."""
    major, minor, patch = (int(n) for n in dr.detail.llvm_version())
    return BackendProbe((major, minor, patch) if major > 0 else None, bool(dr.has_backend(dr.JitBackend.CUDA)))


def choose_backend(requested: str = "auto", machine: BackendProbe | None = None) -> str:
    """Return the backend to use: 'cuda', 'llvm' or 'scalar'.

    Parameters
    ----------
    requested : str, default 'auto'
        Name of a backend, or 'auto' for the fastest one that the machine can run.
    machine : BackendProbe, optional
        Capabilities of the machine; by default, this machine is probed.

    Raises
    ------
    BadInput
        If the name is unknown, or the machine cannot run the backend.
    """
    machine = machine or probe_backends()
    if requested == "auto":
        return "cuda" if machine.cuda else "llvm" if machine.llvm_usable else "scalar"
    if requested not in MITSUBA_VARIANTS:
        raise unknown("variant", requested, allowed=["auto", *MITSUBA_VARIANTS])
    if requested == "llvm" and not machine.llvm_usable:
        raise BadInput(f"variant llvm cannot run here: {machine.llvm_description}", hint=ADVICE)
    if requested == "cuda" and not machine.cuda:
        raise BadInput(
            "variant cuda cannot run here: no NVIDIA card with a driver that Mitsuba can use was found",
            allowed="llvm, scalar",
        )
    return requested


def can_render_waves(name: str) -> bool:
    """Return whether a backend can render diffraction; scalar uses Mitsuba's thin lens, and cannot."""
    return name != "scalar"


def activate_backend(name: str, *, threads: int | None = None) -> None:
    """Switch Mitsuba to a backend and set its number of threads, by default the cores that this process may use.

    Must be called before a scene is loaded, because loading starts the thread pool. Raises BadInput if this process may
    address too little memory, because Mitsuba and LLVM would then abort.
    """
    check_address_space(MIN_MEMORY)
    dr.set_thread_count(threads or usable_cores())
    numba.set_num_threads(min(threads or usable_cores(), numba.config.NUMBA_NUM_THREADS))  # type: ignore[attr-defined]
    mi.set_log_level(mi.LogLevel.Error)
    mi.set_variant(MITSUBA_VARIANTS[name])


def read_picture(file: str) -> mi.Bitmap:
    """Return a picture that Mitsuba reads.

    It hands parts of an OpenEXR file to other threads, and if there is only one, it waits for ever. Raises
    RuntimeError if the file cannot be read.
    """
    threads = dr.thread_count()
    dr.set_thread_count(max(threads, 2))
    try:
        return mi.Bitmap(file)
    finally:
        dr.set_thread_count(threads)
