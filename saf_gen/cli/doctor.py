"""Facts about this machine, and a short check of optics, encoder and spikes, as ``saf-gen doctor`` shows them."""

import hashlib
import math
import os
import platform
from collections.abc import Callable
from dataclasses import asdict
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from saf_gen.camera import encode, get_sensor
from saf_gen.camera.counting_law import count_deviations, count_variance, noise_per_spike
from saf_gen.core import cores
from saf_gen.core.extras import RENDERER, installed_version
from saf_gen.core.kernel_cache import choose_kernel_cache
from saf_gen.errors import BadInput
from saf_gen.optics.lens_card import ImageDistanceLens
from saf_gen.scene.scene_folder import load_scene
from saf_gen.scene.trusted_folders import all_trusted

PACKAGES = ("mitsuba", "drjit", "numpy", "numba", "scipy", "h5py", "isal", "OpenEXR", "matplotlib", "av")
FOCAL_MM, F_NUMBER, FOCUS_M, EDGE_M = 25.0, 2.0, (0.7, 0.4), 0.5
CARD = f"""\
id: edge
title: A glowing half plane
licence: Apache-2.0
source: made here
camera: {{origin_m: [0.0, 0.0, 0.0], look_at_m: [0.0, 0.0, 1.0]}}
lens: {{drive: image_distance, focal_length_mm: {FOCAL_MM}, f_number: {F_NUMBER}, focus_range_m: {list(FOCUS_M)}}}
lights: {{glow: [glow]}}
target: [glow]
"""
SCENE = f"""\
<scene version="3.0.0">
  <shape type="rectangle" id="glow">
    <transform name="to_world"><rotate y="1" angle="180"/><translate x="1" z="{EDGE_M}"/></transform>
    <emitter type="area"><rgb name="radiance" value="1 1 1"/></emitter>
  </shape>
</scene>
"""
SPIKES_SHA256 = "284fe5c6fbbd1cc2a2bad88d343db15b54f6297f91865dc4aa8dc6c0e8b94654"
"""Digest of the spikes of :func:`check_spikes`, which are the same on every machine."""


def describe_machine() -> tuple[dict[str, str], list[str]]:
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
        facts["NVIDIA card"] = "usable" if found.cuda else found.card_problem or "none that Mitsuba can use"
        if found.card_problem:
            advice.append(f"to use the card: {backend.CARD_ADVICE}")
        if not found.llvm_usable and not found.cuda:
            advice.append(f"to be faster: {backend.ADVICE}")
    limits = cores.core_limits()
    least = min(limits.values())
    decisive = ", ".join(name for name, count in limits.items() if count == least)
    others = "".join(f"; {name}: {count}" for name, count in limits.items() if count > least)
    facts["cores"] = f"{least} usable of {os.cpu_count()}, by {decisive}{others}"
    if hasattr(os, "sysconf"):  # not on Windows
        facts["memory"] = f"{os.sysconf('SC_PAGE_SIZE') * os.sysconf('SC_PHYS_PAGES') / 2**30:.1f} GiB"
    facts["system"] = f"{platform.system()} {platform.release()} {platform.machine()}"
    if cores.IS_WINDOWS:
        advice.append(cores.WINDOWS_ADVICE)
    facts["compiled kernels"] = choose_kernel_cache()
    facts["scenes of yours"] = ", ".join(str(folder) for folder in all_trusted()) or "none registered"
    facts["Python"] = platform.python_version()
    for name in PACKAGES:
        facts[name] = installed_version(name)
    return facts, advice


def self_check() -> dict[str, tuple[bool, str]]:
    """Return, for each check, whether it passed and what it found; it takes at most 20 seconds and needs no checkout.

    The blur of an edge is compared with the thin lens, the rate and intervals of spikes with their law, and spikes with
    those of other machines. An error is a check that has not passed.
    """
    checks = {"edge out of focus": check_blur, "rate and intervals": check_encoder, "spikes": check_spikes}
    return {name: _run(check) for name, check in checks.items()}


def _run(check: Callable[[], tuple[bool, str]]) -> tuple[bool, str]:
    try:
        return check()
    except Exception as error:  # noqa: BLE001  (whatever is broken here is what the user wants to know)
        return False, f"{type(error).__name__}: {error}"


def check_blur() -> tuple[bool, str]:
    """Compare the disc that blurs an edge with the thin lens, c = 2R·v·|1/d − 1/u|, in the drive and in a render."""
    focal, focused, pitch_m = FOCAL_MM / 1000, FOCUS_M[0], get_sensor("vidar_400x250").pitch_m
    image_m = focal * focused / (focused - focal)
    law = focal / F_NUMBER * image_m * abs(1 / EDGE_M - 1 / focused) / pitch_m
    drive = ImageDistanceLens(f_number=F_NUMBER, focal_length_mm=FOCAL_MM, focus_range_m=FOCUS_M).build_drive()
    stated = float(drive.blur_diameter(0.0, EDGE_M)) / pitch_m
    passed, said = math.isclose(stated, law, rel_tol=1e-9), f"{stated:.2f} pixels by the drive"
    if all(find_spec(name) is not None for name in RENDERER):
        seen = _rendered_blur()
        passed, said = passed and math.isclose(seen, law, rel_tol=0.02), f"{said}, {seen:.2f} rendered"
    return passed, f"{said}, {law:.2f} by law"


def _rendered_blur() -> float:
    """Return the diameter (pixels) of the disc that blurs the edge in a render at position 0.

    The differences between columns are the distribution of the edge. Its variance is that of a disc of diameter c,
    c²/16, and 1/6 more because columns are one pixel wide and one pixel apart. Noise moves c by 0.3 % rms.
    """
    from saf_gen.render import one_pass, thin_lens
    from saf_gen.render.scene_renderer import SceneRenderer

    with TemporaryDirectory() as temporary:
        folder = Path(temporary) / "edge"
        folder.mkdir()
        (folder / "scene.yaml").write_text(CARD)
        (folder / "scene.xml").write_text(SCENE)
        sensor = get_sensor("vidar_400x250", rows=16, columns=48)
        renderer = SceneRenderer(load_scene(folder), sensor, backend_name="auto")
        setup = renderer.prepare()
    if renderer.is_slow:
        picture = thin_lens.render_position(setup, position=0.0, samples=2048, seed=1)
    else:
        picture = one_pass.render_stack(setup, positions=3, samples=256, seed=1)[0][0]
    steps = np.diff(picture.mean(axis=0, dtype=np.float64))
    steps /= steps.sum()
    columns = np.arange(steps.size)
    return 4 * math.sqrt(float(steps @ (columns - steps @ columns) ** 2) - 1 / 6)


def check_encoder() -> tuple[bool, str]:
    """Compare the interval after each spike of one readout, under even light, with its mean and variance by law."""
    switches = {name: name in ("shot", "threshold_noise") for name in asdict(get_sensor("vidar_400x250").noise)}
    sensor = get_sensor("vidar_400x250", noise=switches)
    rate, first, frames = 0.25, 20, 40  # about every fourth readout; noise makes some intervals 3 or 5
    charge = rate * sensor.threshold_e / (1 - sensor.reset_loss * rate)
    packed = encode(np.full((1, 250, 400), charge, np.float32), sensor, frames=frames, seed=1)
    spikes = np.unpackbits(packed, axis=2, bitorder="little").reshape(-1, 8 * packed.shape[2])[:, first:frames]
    seen = spikes[spikes[:, 0] == 1, 1:].argmax(axis=1) + 1
    variance = noise_per_spike(sensor) / rate**2
    off_mean = (seen.mean() - 1 / rate) / math.sqrt(count_variance(1 / rate, variance) / seen.size)
    off_variance = count_deviations(seen, 1 / rate, variance=variance)
    said = f"mean of {seen.size:,} off by {off_mean:+.1f} sd, variance by {off_variance:+.1f} sd"
    return bool(max(abs(off_mean), abs(off_variance)) < 5), said


def check_spikes() -> tuple[bool, str]:
    """Compare spikes of changing charge, with all noise, with the spikes of other machines."""
    charge = (np.arange(3 * 20 * 33) * 7919 % 12_000).astype(np.float32).reshape(3, 20, 33)
    digest = hashlib.sha256(encode(charge, "vidar_400x250", frames=2_000, seed=11).tobytes()).hexdigest()
    return digest == SPIKES_SHA256, f"digest {digest:.12}, on other machines {SPIKES_SHA256:.12}"
