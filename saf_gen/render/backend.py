"""The choice of Mitsuba's backend: cuda if possible, else llvm, else scalar.

LLVM 15 and 16 abort the process at the first kernel ("cannot select fminimum"), which cannot be caught, so LLVM is
judged by its version. A card is judged by a ray that it traces in another process: without the driver's library OptiX,
which containers leave out, CUDA is there and a scene cannot be loaded or comes out black.
"""

import ctypes
import os
import subprocess
import sys
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numba

from saf_gen.core.cores import check_address_space, usable_cores
from saf_gen.errors import BadInput, unknown

OLDEST_LLVM = 17
MIN_MEMORY = 3 << 30
MEMORY_PER_BAND = 6 << 30  # of a card; several times what the arrays of a band take
MAX_BANDS = 8
MITSUBA_VARIANTS = {"cuda": "cuda_ad_mono", "llvm": "llvm_ad_mono", "scalar": "scalar_rgb"}
CARD_VERDICT = "SAF_GEN_CARD_VERDICT"  # variable that hands the verdict on the card to the processes of workers
CARD_SECONDS = 180  # the driver compiles OptiX's own programs once, before the first ray
CARD_ADVICE = "in a container, let the driver and its OptiX in: NVIDIA_DRIVER_CAPABILITIES=compute,utility,graphics"
TRACE_TRIANGLE = f"""\
import mitsuba as mi
mi.set_variant({MITSUBA_VARIANTS["cuda"]!r})
mesh = mi.Mesh("triangle", 3, 1)
values = mi.traverse(mesh)
values["vertex_positions"] = [-1.0, -1.0, 2.0, 1.0, -1.0, 2.0, 0.0, 1.0, 2.0]
values["faces"] = [0, 1, 2]
values.update()
hit = mi.load_dict({{"type": "scene", "triangle": mesh}}).ray_intersect(mi.Ray3f([0, 0, 0], [0, 0, 1]))
print("traced" if abs(hit.t[0] - 2) < 1e-3 else f"a ray met a triangle {{hit.t[0]}} away instead of 2")
"""
ADVICE = "install LLVM 17 or newer (Debian, Ubuntu: apt install libllvm19) to render many times faster"


@dataclass(frozen=True)
class BackendProbe:
    """The rendering capabilities of a machine.

    Attributes
    ----------
    llvm : tuple of int or None
        Version of LLVM; None if no library was found.
    cuda : bool
        Whether a card has traced a ray.
    card_problem : str, default ''
        Why a card that is there has traced none.
    """

    llvm: tuple[int, int, int] | None
    cuda: bool
    card_problem: str = ""

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
    """Return the version of LLVM, without starting a kernel, and whether a card traces a ray, in another process."""
    major, minor, patch = (int(n) for n in dr.detail.llvm_version())
    has_card = bool(dr.has_backend(dr.JitBackend.CUDA))
    problem = _judge_card() if has_card else ""
    return BackendProbe((major, minor, patch) if major > 0 else None, has_card and not problem, problem)


def _judge_card() -> str:
    """Return why the card traces no ray, in one line, or an empty string; asked once for this process and its workers.

    A process of its own, because a driver without OptiX may end the process.
    """
    if CARD_VERDICT not in os.environ:
        os.environ[CARD_VERDICT] = _trace_triangle()
    return os.environ[CARD_VERDICT]


def _trace_triangle() -> str:
    command = [sys.executable, "-c", TRACE_TRIANGLE]
    try:
        run = subprocess.run(
            command, capture_output=True, text=True, errors="replace", timeout=CARD_SECONDS, check=False
        )
    except subprocess.TimeoutExpired:
        return f"no ray within {CARD_SECONDS} s"
    if run.returncode == 0 and run.stdout.strip() == "traced":
        return ""
    said = [line.strip() for line in (run.stderr or run.stdout).splitlines() if line.strip()]
    return said[-1][:200] if said else f"a ray ended the process (exit code {run.returncode})"


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
        why = f"the card traces nothing: {machine.card_problem}" if machine.card_problem else "no NVIDIA card was found"
        others = "llvm, scalar" if machine.llvm_usable else "scalar"
        raise BadInput(f"variant cuda cannot run here: {why}", allowed=others, hint=CARD_ADVICE)
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


def bands_at_once() -> int:
    """Return how many bands of 2²⁰ rays the device traces at once: on the cores one, on a card as its memory allows.

    A band launches some kernels, which take a card less time than their launch takes the processor.
    """
    if mi.variant() != MITSUBA_VARIANTS["cuda"]:
        return 1
    size = ctypes.c_size_t(0)
    try:
        ctypes.CDLL("nvcuda.dll" if sys.platform == "win32" else "libcuda.so.1").cuDeviceTotalMem_v2(
            ctypes.byref(size), 0
        )
    except OSError:  # the driver's library has another name
        return 1
    return min(max(size.value // MEMORY_PER_BAND, 1), MAX_BANDS)
