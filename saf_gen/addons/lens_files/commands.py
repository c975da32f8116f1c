"""The commands ``lens fit`` and ``lens show``."""

import math
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from saf_gen.cli._tables import print_facts
from saf_gen.cli._terminal import out
from saf_gen.cli.command import NOTHING_WRITTEN, Command, Panel
from saf_gen.errors import BadInput

if TYPE_CHECKING:
    from saf_gen.optics.fitted_file import FittedLens


def fit_lens_command(
    file: Annotated[Path, typer.Argument(help="Lens file: Zemax (.zmx), or a table of surfaces (.yaml).")],
    *,
    to: Annotated[Path | None, typer.Option("--out", help="File to write (.yaml); default: the name of FILE.")] = None,
    f_number: Annotated[
        float | None, typer.Option(help="Smallest f-number to cover; default: that of the file.")
    ] = None,
    height_mm: Annotated[
        float | None,
        typer.Option(help="Image height to cover, mm: half the diagonal of the sensor. Default: the file's."),
    ] = None,
    nearest_m: Annotated[
        float | None, typer.Option(help="Nearest object in focus to cover, m. Default: ten focal lengths.")
    ] = None,
    waves_nm: Annotated[
        str | None, typer.Option(help="Wavelengths to cover, SHORTEST,LONGEST in nm. Default: the file's.")
    ] = None,
    degree: Annotated[int, typer.Option(help="Degree of the polynomials: 3, 5, 7, 9, 11 or 13.")] = 9,
    glass: Annotated[
        list[str] | None, typer.Option(help="A glass that the catalogue lacks, NAME=INDEX/ABBE; may be repeated.")
    ] = None,
    catalogue: Annotated[
        list[Path] | None, typer.Option(help="A maker's catalogue of glasses (.agf); may be repeated.")
    ] = None,
) -> None:
    """Fit polynomials to the rays of a real lens, which a scene card then names as its lens."""
    from saf_gen.addons.lens_files.fit import MARK, find_reach, fit_lens, fitted_text
    from saf_gen.addons.lens_files.reading import read_glasses, read_prescription
    from saf_gen.core.config.presets import is_preset_file
    from saf_gen.core.files import check_apart, check_ours, check_writable, write_text

    lens = read_prescription(
        file, glasses=read_glasses(glass or (), catalogue or ()), f_number=f_number, height_mm=height_mm
    )
    target = to or Path(f"{file.stem}.yaml")
    if not is_preset_file(target):
        raise BadInput(f"--out is {target}", allowed="a file name that ends in .yaml")
    check_apart(file, target)
    check_writable(target.parent)
    check_ours(target, MARK)
    reach = find_reach(
        lens, f_number=f_number, height_mm=height_mm, nearest_m=nearest_m, waves_nm=_two_numbers(waves_nm)
    )
    made_with = " ".join(f"saf-gen lens fit {shlex.quote(file.name)} {_options(locals())}".split())
    found = fit_lens(lens, reach, degree=degree, source=file.name, made_with=made_with)
    write_text(target, fitted_text(found))
    _print_lens(found)
    for note in found.notes:
        out.print(f"note: {note}", soft_wrap=True)
    out.print(str(target), soft_wrap=True)
    widest = math.ceil(100 * found.f_number) / 100
    card = f"lens: {{file: {target.name}, f_number: {widest:g}, focus_range_m: [FIRST, LAST]}}"
    out.print(
        f"next: saf-gen lens show {shlex.quote(str(target))}; in scene.yaml: {card}", soft_wrap=True, markup=False
    )


def show_lens_command(
    name: Annotated[str, typer.Argument(help="Name of a lens, or the file (.yaml) that lens fit wrote.")],
    *,
    to: Annotated[Path | None, typer.Option("--out", help="Figure to write (.png); default: the lens's name.")] = None,
) -> None:
    """Print what a fitted lens does, and draw its spots, aberrations and relative illumination."""
    from saf_gen.addons.lens_files.sheet import draw_lens
    from saf_gen.core.files import check_writable, refuse_link
    from saf_gen.optics.fitted_file import read_lens

    lens = read_lens(name)
    target = to or Path(f"{Path(name).stem}.png")
    if target.suffix.lower() != ".png":
        raise BadInput(f"--out is {target}", allowed="a file name that ends in .png")
    refuse_link(target)
    check_writable(target.parent)
    if target.is_dir():
        raise BadInput(f"{target} is a folder", allowed="a file name that ends in .png")
    draw_lens(lens, target)
    _print_lens(lens)
    out.print(str(target), soft_wrap=True)


def _two_numbers(text: str | None) -> tuple[float, float] | None:
    if text is None:
        return None
    try:
        low, high = (float(part) for part in text.split(","))
    except ValueError:
        low = high = float("nan")
    if not 200 <= low < high <= 3000:
        raise BadInput(f"--waves-nm is {text!r}", allowed="SHORTEST,LONGEST in nm, such as 450,650, from 200 to 3000")
    return low, high


def _options(given: dict[str, object]) -> str:
    """Return the options of ``lens fit`` that were given, as text for the command line."""
    words = []
    for key in ("f_number", "height_mm", "nearest_m", "waves_nm", "degree", "glass", "catalogue"):
        values = given[key] if isinstance(given[key], list) else [given[key]]
        words += [f"--{key.replace('_', '-')} {shlex.quote(str(v))}" for v in values if v is not None]  # type: ignore[attr-defined]
    return " ".join(words)


def _print_lens(lens: "FittedLens") -> None:
    from saf_gen.addons.lens_files.sheet import USUAL_PITCH_UM, measure_lens

    found = measure_lens(lens)
    low, high = lens.waves_nm
    facts = {
        "lens": lens.name,
        "made from": lens.source,
        "focal length": f"{lens.focal_length_mm:.4g} mm at {lens.primary_nm:.0f} nm",
        "entrance pupil": f"{lens.focal_length_mm / lens.f_number:.4g} mm wide, {lens.entrance_pupil_mm:.4g} mm behind "
        f"the first vertex; exit pupil {lens.pupil_magnification:.4g} times as wide",
        "fitted for": f"f/{lens.f_number:.3g} and above, image heights to {lens.height_mm:.3g} mm, objects from "
        f"{lens.nearest_m:.3g} m, {low:.0f} to {high:.0f} nm",
        "fitted within": f"{lens.rms_um:.2g} µm rms, {lens.worst_um:.2g} µm at worst on the sensor, "
        f"{lens.rms_um / USUAL_PITCH_UM:.2g} and {lens.worst_um / USUAL_PITCH_UM:.2g} pixels of {USUAL_PITCH_UM:g} µm; "
        f"degree {lens.degree}",
        "spherical aberration": f"{found.spherical_mm:+.3g} mm from the middle to the edge of the aperture",
        "field curvature": f"tangential {found.tangential_mm:+.3g}, sagittal {found.sagittal_mm:+.3g} mm at the height",
        "distortion": f"{found.distortion:+.2%} at the height",
        "axial colour": f"{found.colour_mm:+.3g} mm from {low:.0f} to {high:.0f} nm",
    }
    if lens.relative_illumination:
        facts["light at the height"] = (
            f"{lens.relative_illumination[-1][1]:.0%} of that in the middle, told and not used"
        )
    print_facts(facts)


GROUPS = {"lens": "Fit real lenses for scene cards, and draw them."}
COMMANDS = {
    "lens fit": Command(
        fit_lens_command,
        ("lens fit double_gauss.zmx --height-mm 12", "lens fit design.yaml --out my.yaml --glass BAF7=1.608/46.2"),
        Panel.SCENES,
        NOTHING_WRITTEN,
    ),
    "lens show": Command(
        show_lens_command,
        ("lens show double_gauss", "lens show my_lens.yaml --out my_lens.png"),
        Panel.SCENES,
        NOTHING_WRITTEN,
    ),
}
