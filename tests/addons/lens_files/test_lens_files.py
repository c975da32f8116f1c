"""Lens files: what is read, rays through surfaces against closed forms, and polynomials against rays."""

import numpy as np
import pytest
from lens_texts import LENSES, SINGLET, table_text, zemax_text
from pydantic import TypeAdapter
from ray_by_ray import surfaces_of, traced
from refusals import assert_says, refusal

from saf_gen.addons.lens_files.fit import Reach, find_reach, fit_lens, fitted_text, residuals_um
from saf_gen.addons.lens_files.glass import AIR, catalogue, model_glass
from saf_gen.addons.lens_files.prescription import Prescription, Surface
from saf_gen.addons.lens_files.pupils import find_pupils
from saf_gen.addons.lens_files.reading import read_glasses, read_prescription
from saf_gen.addons.lens_files.trace import Rays, trace_back, trace_forward
from saf_gen.optics import FocusCriterion
from saf_gen.optics.fitted_file import read_lens, shipped_lenses
from saf_gen.optics.lens_card import LensCard

D_NM, PITCH_M = 587.5618, 20e-6


def lens_of(*surfaces, stop=0, aperture=("entrance", 10.0)):
    return Prescription("made", surfaces, stop, aperture, ("angle", 5.0), (D_NM,), D_NM)


def glass(index):
    return model_glass(index, 60.0)


def card(**changes):
    data = {"file": "double_gauss", "f_number": 2.0, "focus_range_m": [2.0, 0.6]}
    return TypeAdapter(LensCard).validate_python({**data, **changes})


def parallel(heights):
    heights = np.atleast_1d(np.asarray(heights, dtype=np.float64))
    return Rays(np.stack([heights, np.zeros_like(heights)]), np.zeros((2, heights.size)))


def crossing(rays):
    return -rays.place[0] / rays.slope[0]


# --- the tracer, against closed forms ---


@pytest.mark.parametrize(("r1", "r2", "thickness"), [(50, -80, 6), (30, np.inf, 4), (-200, -40, 3), (25, 60, 8)])
def test_a_singlet_has_the_focal_length_of_the_lensmaker(r1, r2, thickness):
    """1/f = (n - 1)·(1/r1 - 1/r2 + (n - 1)·d/(n·r1·r2)), and its back focus f·(1 - (n - 1)·d/(n·r1))."""
    n = 1.6
    lens = lens_of(Surface(1 / r1, thickness, glass(n)), Surface(1 / r2, 0.0))
    f = 1 / ((n - 1) * (1 / r1 - 1 / r2 + (n - 1) * thickness / (n * r1 * r2)))
    assert find_pupils(lens, D_NM).focal_length_mm == pytest.approx(f, rel=1e-9)
    rays, _ = trace_forward(lens, parallel(1e-4), wavelength_nm=D_NM)
    assert crossing(rays)[0] == pytest.approx(f * (1 - (n - 1) * thickness / (n * r1)), rel=1e-8)


def test_a_plano_convex_lens_has_seidels_spherical_aberration():
    """Its rays at height y cross the axis S_I/(2·u²) before the paraxial focus, S_I = -Σ A²·h·Δ(u/n) (Welford, ch. 8).

    At y = f/50 terms of the fifth order are below 0.5 %.
    """
    n, r, thickness, y = 1.5, 50.0, 5.0, 2.0
    lens = lens_of(Surface(1 / r, thickness, glass(n)), Surface(0.0, 0.0))
    u1 = -y * (n - 1) / (n * r)
    h2 = y + thickness * u1
    u2 = n * u1
    first = (y / r) ** 2 * y * (u1 / n - 0)  # A = n·i = y/r
    second = (n * u1) ** 2 * h2 * (u2 - u1 / n)
    seidel = -(first + second)
    rays, _ = trace_forward(lens, parallel([1e-4, y]), wavelength_nm=D_NM)
    near, edge = crossing(rays)
    assert edge - near == pytest.approx(-seidel / (2 * u2**2), rel=5e-3)


def test_a_sphere_is_free_of_spherical_aberration_at_its_aplanatic_points():
    """Rays towards the point n·r behind the centre of a ball meet at r/n behind it, at every height up to 0.9·r."""
    n, r = 1.5, 10.0
    lens = lens_of(Surface(1 / r, 0.0, glass(n)))
    aim = r + n * r
    heights = np.linspace(0.5, 9.0, 18)
    sag = r - np.sqrt(r**2 - heights**2)
    slope = -heights / (aim - sag)
    start = Rays(np.stack([heights - sag * slope, 0 * heights]), np.stack([slope, 0 * slope]))
    rays, met = trace_forward(lens, start, wavelength_nm=D_NM)
    assert met[0] == pytest.approx(heights, rel=1e-12)
    assert crossing(rays) == pytest.approx(r + r / n, rel=1e-12)


def test_an_ellipsoid_of_conic_minus_one_over_n_squared_focuses_parallel_light():
    """Parallel rays that enter glass through it meet in one point, f = n·r/(n - 1) behind the vertex (Descartes)."""
    n, r = 1.6, 20.0
    lens = lens_of(Surface(1 / r, 0.0, glass(n), conic=-1 / n**2))
    rays, _ = trace_forward(lens, parallel(np.linspace(0.5, 15, 9)), wavelength_nm=D_NM)
    assert crossing(rays) == pytest.approx(n * r / (n - 1), rel=1e-12)


def test_powers_of_r_are_those_of_the_conic_that_they_expand():
    """A sphere as a plane with a1 to a8 of its series bends rays alike, within the ninth term."""
    r, series = 40.0, []
    term = 1 / (2 * r)
    for k in range(1, 9):
        series.append(term)
        term *= (2 * k - 1) / (2 * k + 2) / r**2
    sphere, even = (lens_of(one, Surface(0.0, 0.0)) for one in (
        Surface(1 / r, 5.0, glass(1.6)), Surface(0.0, 5.0, glass(1.6), powers=tuple(series)))
    )  # fmt: skip
    assert find_pupils(even, D_NM).focal_length_mm == pytest.approx(
        find_pupils(sphere, D_NM).focal_length_mm, rel=1e-12
    )
    found, expected = (
        trace_forward(one, parallel(np.linspace(1, 8, 8)), wavelength_nm=D_NM)[0] for one in (even, sphere)
    )
    assert found.slope == pytest.approx(expected.slope, abs=1e-8)


def test_rays_go_back_the_way_they_came():
    """Forward and then back with the axis turned round, through the double Gauss: within 1e-9 mm."""
    lens = read_prescription(LENSES / "double_gauss.zmx")
    rng = np.random.default_rng(5)
    start = Rays(rng.uniform(-8, 8, (2, 50)), rng.uniform(-0.1, 0.1, (2, 50)))
    there, _ = trace_forward(lens, start, wavelength_nm=550.0)
    back, _ = trace_back(lens, Rays(there.place, -there.slope), wavelength_nm=550.0)
    assert back.place == pytest.approx(start.place, abs=1e-9)
    assert back.slope == pytest.approx(-start.slope, abs=1e-11)


def test_glasses_have_the_indices_of_their_data_sheets():
    """n_d and Abbe's number of Schott's and Ohara's sheets, to their five and two digits."""
    for name, index, abbe in (("N-BK7", 1.5168, 64.17), ("N-SF11", 1.78472, 25.68), ("S-LAH66", 1.7725, 49.6)):
        found = catalogue()[name]
        n_d, n_f, n_c = map(found.index, (0.5875618, 0.4861327, 0.6562725))
        assert n_d == pytest.approx(index, abs=6e-6)
        assert (n_d - 1) / (n_f - n_c) == pytest.approx(abbe, abs=6e-3)
    model = model_glass(1.7, 40.0)
    n_d, n_f, n_c = map(model.index, (0.5875618, 0.4861327, 0.6562725))
    assert (n_d, (n_d - 1) / (n_f - n_c)) == (pytest.approx(1.7, abs=1e-12), pytest.approx(40.0, rel=1e-9))


# --- reading ---


@pytest.mark.parametrize(("file", "text"), [("a.zmx", zemax_text()), ("a.yaml", table_text())])
def test_every_format_gives_the_surfaces_that_were_written(file, text, tmp_path):
    (tmp_path / file).write_text(text)
    lens = read_prescription(tmp_path / file)
    assert (lens.name, lens.stop, lens.primary_nm) == ("Singlet", 2, D_NM)
    assert (lens.waves_nm[0], lens.waves_nm[-1]) == (486.1327, 656.2725)
    for surface, (radius, thickness, medium) in zip(lens.surfaces, SINGLET, strict=True):
        assert surface.curvature == pytest.approx(0 if radius == "stop" else 1 / radius, rel=1e-12)
        assert surface.thickness_mm == pytest.approx(thickness)
        assert surface.glass == (model_glass(*medium, name=surface.glass.name) if medium else AIR)
    pupils = find_pupils(lens, D_NM)
    expected = pupils.focal_length_mm / 9 if file == "a.yaml" else 6.0
    assert pupils.entrance_radius_mm(lens.aperture) == pytest.approx(expected)
    assert lens.field == (("image", 5.0) if file == "a.yaml" else ("angle", 5.0))


def test_a_table_states_aspheres_and_names_glasses(tmp_path):
    text = table_text().replace(
        "glass: [1.5168, 64.17]", "glass: n-bk7, conic: -0.5, powers: [0, 1e-6], semi_diameter_mm: 7"
    )
    (tmp_path / "a.yaml").write_text(text)
    surface = read_prescription(tmp_path / "a.yaml").surfaces[0]
    assert surface == Surface(0.02, 6.0, catalogue()["N-BK7"], -0.5, (0.0, 1e-6), 7.0)


def test_only_the_wavelengths_and_fields_that_a_file_counts_are_its_own(tmp_path):
    """Newer files list 24 wavelengths and 12 fields, of which the first are in use."""
    more = [f"WAVM {n} 0.55 1" for n in range(4, 25)]
    (tmp_path / "a.zmx").write_text(
        zemax_text(system=more).replace("YFLN 0 5", "YFLN 0 5 9").replace("XFLN 0 0", "XFLN 0 0 9")
    )
    lens = read_prescription(tmp_path / "a.zmx")
    assert (lens.waves_nm, lens.field) == ((486.1327, 587.5618, 656.2725), ("angle", 5.0))


def test_tolerances_and_merit_function_behind_the_surfaces_are_not_read(tmp_path):
    (tmp_path / "a.zmx").write_text(zemax_text() + "TOL TOFF 0 0\nMNUM 1 1\nEFLY 2 13 0 0 0 0 4.9E+1 9.9E+1 0 0\n")
    assert len(read_prescription(tmp_path / "a.zmx").surfaces) == 3


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "utf-8-sig", "latin-1"])
def test_a_zmx_file_is_read_in_every_encoding_that_zemax_writes(encoding, tmp_path):
    text = zemax_text(system=["NOTE 0 Übung"])
    (tmp_path / "a.zmx").write_bytes(text.encode(encoding))
    assert read_prescription(tmp_path / "a.zmx").surfaces[0].curvature == 0.02


def test_lengths_in_inches_are_millimetres_and_coefficients_follow(tmp_path):
    inch = 25.4
    rows = tuple((r if r == "stop" else r / inch, d / inch, g) for r, d, g in SINGLET)
    even = {1: ["  TYPE EVENASPH", f"  PARM 2 {1e-6 * inch**3!r}"]}
    text = zemax_text(rows, extra=even).replace("UNIT MM", "UNIT IN").replace("ENPD 12", f"ENPD {12 / inch!r}")
    (tmp_path / "in.zmx").write_text(text)
    (tmp_path / "mm.zmx").write_text(zemax_text(extra={1: ["  TYPE EVENASPH", "  PARM 2 1e-06"]}))
    found, expected = (read_prescription(tmp_path / name) for name in ("in.zmx", "mm.zmx"))
    for one, other in zip(found.surfaces, expected.surfaces, strict=True):
        assert (one.curvature, one.thickness_mm) == pytest.approx((other.curvature, other.thickness_mm))
        assert one.powers == pytest.approx(other.powers)
    assert found.aperture[1] == pytest.approx(12)


def test_what_a_file_says_and_nothing_uses_is_told(tmp_path):
    text = zemax_text(extra={1: ["  CLAP 0 5 0"]}).replace("DISZ INFINITY", "DISZ 700")
    (tmp_path / "a.zmx").write_text(text)
    notes = " | ".join(read_prescription(tmp_path / "a.zmx").notes)
    for words in ("apertures of surfaces 1", "object is 700 mm"):
        assert words in notes


def with_stop(radius_mm, *, f_number=4.5):
    """The table of a lens of 60.49 mm whose stop is 0.926 times as wide as its entrance pupil."""
    text = table_text().replace("stop: true", f"stop: true, semi_diameter_mm: {radius_mm}")
    return text.replace("f_number: 4.5", f"f_number: {f_number}")


STATED = {
    "0.8 % off": ("a.yaml", table_text() + "focal_length_mm: 60\n", ""),
    "2.5 % off": ("a.yaml", table_text() + "focal_length_mm: 59\n", "a focal length of 59 mm, its rays have 60.49 mm"),
    "a stop of its f-number": ("a.yaml", with_stop(6.224), ""),
    "a stop of another": ("a.yaml", with_stop(7.0), "states f/4.5, a stop of 7 mm radius passes f/4: f/4.5 counts"),
    "no room for its f-number": ("a.yaml", with_stop(6.224, f_number=4.0), "a stop of 6.224 mm radius passes f/4.5"),
    "a pupil of another": ("a.zmx", zemax_text(extra={3: ["  DIAM 5"]}), "states f/5.04, a stop of 5 mm radius passes"),
    "open to its stop": ("a.zmx", zemax_text(drop=("ENPD",), system=["FLOA"], extra={3: ["  DIAM 5"]}), ""),
}  # fmt: skip


@pytest.mark.parametrize(("file", "text", "note"), STATED.values(), ids=STATED)
def test_what_a_file_states_otherwise_than_its_rays_by_over_one_per_cent_is_told(file, text, note, tmp_path):
    (tmp_path / file).write_text(text)
    notes = read_prescription(tmp_path / file).notes
    assert len(notes) == bool(note)
    assert note in "".join(notes)
    assert read_prescription(tmp_path / file, f_number=8.0).notes == (notes if "focal" in note else ())


def test_a_glass_may_be_stated_or_come_from_a_catalogue(tmp_path):
    text = zemax_text().replace("___BLANK 1 0 1.5168 64.17", "HARD7 0 0 1.5 40")
    (tmp_path / "a.zmx").write_text(text)
    assert_says(refusal(read_prescription, tmp_path / "a.zmx"), "HARD7 | --glass HARD7=INDEX/ABBE | --catalogue")
    (tmp_path / "maker.agf").write_text(
        "CC made up\nNM HARD7 2 0 1.5 64 0 0 0\n"
        "CD 1.03961212 0.00600069867 0.231792344 0.0200179144 1.01046945 103.560653\nLD 0.3 2.5\n"
    )
    for more in (read_glasses(["HARD7=1.5168/64.17"], ()), read_glasses((), [tmp_path / "maker.agf"])):
        lens = read_prescription(tmp_path / "a.zmx", glasses=more)
        assert lens.surfaces[0].glass.index(0.5875618) == pytest.approx(1.5168, abs=1e-5)


def test_a_glass_is_not_another_one_whose_name_begins_alike(tmp_path):
    """OKP4 is 1.607/27, OKP4HT 1.633/23: it is asked for, although the file lists numbers and OKP4HT is known."""
    (tmp_path / "a.zmx").write_text(zemax_text().replace("___BLANK 1 0 1.5168 64.17", "OKP4 0 0 1.633 23.3"))
    other = read_glasses(["OKP4HT=1.633/23.3"], ())
    error = refusal(read_prescription, tmp_path / "a.zmx", glasses=other)
    assert_says(error, "surface 1 is of the unknown glass 'OKP4' | --glass OKP4=INDEX/ABBE")
    lens = read_prescription(tmp_path / "a.zmx", glasses=other | read_glasses(["OKP4=1.607/27"], ()))
    assert lens.surfaces[0].glass.index(0.5875618) == pytest.approx(1.607)


BAD = {
    "empty": ("", "0 surfaces"),
    "words": ("once upon a time\n", "lens.zmx:1: | the record 'once' is not known"),
    "zeros": ("\0" * 200, "is not known"),
    "cut in the system": (zemax_text()[:60], "0 surfaces"),
    "cut in a surface": (zemax_text().split("SURF 2")[0] + "SURF 2\n", "is no image | complete"),
    "cut after two surfaces": (zemax_text().split("SURF 2")[0], "2 surfaces | complete"),
    "cut behind a surface": (zemax_text().rsplit("SURF ", 1)[0], "is no image | complete"),
    "a curved image": (zemax_text().rsplit("CURV 0", 1)[0] + "CURV 0.01\n  DISZ 0\n", "is no image"),
    "an image with a glass": (zemax_text() + "  GLAS N-BK7\n", "is no image"),
    "cut in a number": (zemax_text().replace("DISZ 2.0", "DISZ"), "damaged | number"),
    "no curvature": (zemax_text().replace("  CURV 0.02\n", ""), "surface 1 | no CURV"),
    "radius that is no number": (zemax_text().replace("CURV 0.02", "CURV nan"), "NaN"),
    "radius of words": (zemax_text().replace("CURV 0.02", "CURV flat"), "damaged | flat"),
    "infinite curvature": (zemax_text().replace("CURV 0.02", "CURV INFINITY"), "surface 1 | finite radius"),
    "unknown glass": (zemax_text().replace("___BLANK 1 0 1.5168 64.17", "N-BK77 0 0"), "N-BK77 | 'N-BK7' | --glass"),
    "glass of index 0.9": (zemax_text().replace("1.5168 64.17", "0.9 64.17"), "index is 0.9"),
    "Abbe number 0": (zemax_text().replace("1.5168 64.17", "1.5168 0"), "Abbe number is 0"),
    "mirror": (zemax_text(extra={2: ["  GLAS MIRROR 0 0"]}), "surface 2 is a mirror"),
    "coordinate break": (zemax_text(extra={2: ["  TYPE COORDBRK"]}), "surface 2 is of type COORDBRK | on one axis"),
    "toroid": (zemax_text(extra={2: ["  TYPE TOROIDAL"]}), "surface 2 is of type TOROIDAL | EVENASPH"),
    "high power": (zemax_text(extra={2: ["  TYPE EVENASPH", "  PARM 9 1e-20"]}), "coefficient 9"),
    "glass of no thickness": (zemax_text().replace("DISZ 6.0", "DISZ 0"), "surface 1 | 0 mm thick"),
    "negative glass": (zemax_text().replace("DISZ 6.0", "DISZ -6"), "surface 1 | -6 mm thick"),
    "infinite gap": (zemax_text().replace("DISZ 2.0", "DISZ INFINITY"), "surface 2 | thickness of inf"),
    "negative aperture": (zemax_text().replace("ENPD 12", "ENPD -12"), "entrance pupil (mm) is -12"),
    "no aperture": (zemax_text(drop=("ENPD",)), "--f-number"),
    "f-number of a near object": (
        zemax_text(drop=("ENPD",), system=["FNUM 4 1"]).replace("INFINITY", "700"), "how wide | --f-number"
    ),
    "negative semi-diameter": (zemax_text(extra={1: ["  DIAM -4"]}), "semi-diameter of -4"),
    "no field": (zemax_text(drop=("YFLN",)), "--height-mm"),
    "field of object heights": (zemax_text().replace("FTYP 0", "FTYP 1"), "angle or an image height | --height-mm"),
    "field of another kind": (zemax_text().replace("FTYP 0", "FTYP 4"), "angle or an image height | --height-mm"),
    "half a field": (zemax_text().replace("FTYP 0 0 2", "FTYP 0 0 1.5"), "1.5 where a count | whole number"),
    "fields without end": (zemax_text().replace("FTYP 0 0 2", "FTYP 0 0 INFINITY"), "inf where a count"),
    "1e9 fields": (zemax_text(drop=("XFLN",)).replace("FTYP 0 0 2", "FTYP 0 0 1e9"), "1e+09 where a count"),
    "no wavelengths": (zemax_text().replace("FTYP 0 0 2 3", "FTYP 0 0 2 0"), "no wavelength 1"),
    "more wavelengths than it lists": (zemax_text().replace("FTYP 0 0 2 3", "FTYP 0 0 2 4"), "no wavelength 4"),
    "field of 89 degrees": (zemax_text().replace("YFLN 0 5", "YFLN 0 89"), "89°"),
    "no stop": (zemax_text().replace("  STOP\n", ""), "0 surfaces are the stop"),
    "two stops": (zemax_text(extra={1: ["  STOP"]}), "2 surfaces are the stop"),
    "no light": (zemax_text(drop=("WAVM",)), "no wavelength 1"),
    "no count of wavelengths": (zemax_text().replace("FTYP 0 0 2 3 0 0 0", "FTYP 0 0 2"), "how many wavelengths"),
    "fewer fields than it counts": (zemax_text().replace("YFLN 0 5", "YFLN 5"), "damaged"),
    "an obscuration": (zemax_text(extra={1: ["  OBSC 0 2 0"]}), "lens.zmx:21 | 'OBSC' | changes no ray"),
    "a tilt of a surface": (zemax_text(extra={1: ["  SCBD 1 0 0 0.1 0 0"]}), "'SCBD' is not known"),
    "a temperature of its own": (zemax_text(system=["THIC 3"]), "'THIC' is not known"),
    "a surface without its indentation": (zemax_text().replace("  CURV 0.02", "CURV 0.02"), "'CURV' is not known"),
    "three configurations": (zemax_text() + "MNUM 3 1\n", "3 configurations | save"),
    "primary light 7": (zemax_text().replace("PWAV 2", "PWAV 7"), "number 7 | 1 to 3"),
    "primary light 1.5": (zemax_text().replace("PWAV 2", "PWAV 1.5"), "1.5 where a count"),
    "light without a number": (zemax_text().replace("WAVM 1", "WAVM INFINITY"), "inf where a count"),
    "light of 50 µm": (zemax_text().replace("0.6562725", "50"), "50000"),
    "not sequential": (zemax_text().replace("MODE SEQ", "MODE NSC"), "mode NSC"),
    "unit of furlongs": (zemax_text().replace("UNIT MM", "UNIT FURLONG"), "FURLONG"),
    "no glass": (zemax_text(((50.0, 6.0, None), ("stop", 60.0, None))), "has no glass"),
    "ends in glass": (zemax_text(((50.0, 6.0, (1.5, 60)), ("stop", 60.0, (1.5, 60)))), "lens in air"),
}  # fmt: skip


@pytest.mark.parametrize("what", BAD)
def test_a_file_that_is_no_lens_is_refused_in_one_line(what, tmp_path):
    text, fragments = BAD[what]
    (tmp_path / "lens.zmx").write_text(text)
    assert_says(refusal(read_prescription, tmp_path / "lens.zmx"), fragments)


BAD_TABLES = {
    "unknown key": (table_text().replace("f_number", "fnumber"), "a.yaml:2 | 'fnumber' | f_number"),
    "no radius": (table_text().replace("radius_mm: 50.0, ", ""), "radius_mm"),
    "radius 0": (table_text().replace("radius_mm: 50.0", "radius_mm: 0"), "surface 1 | radius of 0"),
    "infinite radius": (table_text().replace("radius_mm: 50.0", "radius_mm: .inf"), "radius_mm"),
    "unknown glass": (table_text().replace("[1.5168, 64.17]", "N-BK77"), "surface 1 | N-BK77 | 'N-BK7'"),
    "two stops": (table_text().replace("64.17]", "64.17], stop: true"), "2 surfaces are the stop"),
    "glass of no thickness": (table_text().replace("thickness_mm: 6.0", "thickness_mm: 0"), "surface 1 | 0 mm thick"),
    "a fitted lens": (None, "unknown key"),
}  # fmt: skip


@pytest.mark.parametrize("what", BAD_TABLES)
def test_a_table_that_is_no_lens_is_refused_in_one_line(what, tmp_path):
    text, fragments = BAD_TABLES[what]
    (tmp_path / "a.yaml").write_text(text or fitted_text(read_lens("double_gauss")))
    assert_says(refusal(read_prescription, tmp_path / "a.yaml"), fragments)


def test_a_file_of_another_format_is_refused_with_those_that_are_read(tmp_path):
    (tmp_path / "lens.json").write_text("{}")
    assert_says(refusal(read_prescription, tmp_path / "lens.json"), "is no lens file | .zmx | .yaml")


def test_a_file_of_200_mb_is_refused_unread(tmp_path):
    with (tmp_path / "a.zmx").open("wb") as file:
        file.truncate(200_000_000)
    assert_says(refusal(read_prescription, tmp_path / "a.zmx"), "200,000,000 bytes | at most")
    (tmp_path / "folder.zmx").mkdir()
    assert_says(refusal(read_prescription, tmp_path / "none.zmx"), "cannot be read")
    assert_says(refusal(read_prescription, tmp_path / "folder.zmx"), "is a folder")


# --- the fit ---


@pytest.fixture(scope="module")
def double_gauss():
    return read_prescription(LENSES / "double_gauss.zmx")


PIXELS_UM = {"double_gauss": 20.0, "c_mount": 4.8, "smartphone": 3.1}  # smallest that the fit serves


@pytest.mark.parametrize("name", PIXELS_UM)
def test_the_fit_of_a_shipped_lens_is_within_a_twentieth_of_a_pixel(name):
    """Over pupil, field, four wavelengths and five positions: 0.05 pixels rms and 0.2 at worst."""
    off = residuals_um(read_lens(name), read_prescription(LENSES / f"{name}.zmx"))
    assert np.sqrt((off**2).mean()) < 0.05 * PIXELS_UM[name]
    assert off.max() < 0.2 * PIXELS_UM[name]


@pytest.mark.parametrize("position", [0.0, 0.25, 0.5, 0.75, 1.0])
def test_rays_of_the_card_land_on_their_pixel_when_traced_through_the_surfaces(double_gauss, position):
    """Rays that the drive sends into the scene, traced back from there surface by surface, meet sensor and pupil.

    400 random rays (seed 2) at the card's wavelength: within 0.05 pixels of 20 µm rms on the sensor, 0.2 at worst, and
    within 5 µm in the exit pupil.
    """
    card = {"file": "double_gauss", "f_number": 2.0, "focus_range_m": [2.0, 0.6], "wave_nm": 550.0}
    drive = TypeAdapter(LensCard).validate_python(card).build_drive()
    lens = read_lens("double_gauss")
    rng = np.random.default_rng(2)
    radius, m = drive.aperture_radius_m, drive.pupil_magnification
    r, angle = np.sqrt(rng.random(400)), 2 * np.pi * rng.random(400)
    a = radius * r * np.stack([np.cos(angle), np.sin(angle)])
    x = 8e-3 * rng.uniform(-1, 1, (2, 400))
    v, u = float(drive.image_distance(position)), float(drive.object_distance(position))
    moved, turned = drive.wavefront.turn(tuple(a), tuple(x), image_distance_m=v)
    start, slope = a + np.stack(moved), -(x / v + a / u) + np.stack(turned)
    rays = Rays(1e3 * start, -slope).at(-lens.entrance_pupil_mm)
    behind, _ = trace_forward(double_gauss, rays, wavelength_nm=550.0)
    at_pupil = behind.at(lens.exit_pupil_mm)
    assert 1e-3 * at_pupil.place == pytest.approx(m * a, abs=5e-6)
    off = np.hypot(*(1e-3 * at_pupil.at(1e3 * m * v).place - x)) / PITCH_M
    assert np.sqrt((off**2).mean()) < 0.05
    assert off.max() < 0.2


def test_a_lens_without_aberrations_is_fitted_as_the_thin_lens():
    """A weak thin lens with its stop in it, at f/500: a drive of magnification 1 and slopes within 1e-7."""
    lens = lens_of(Surface(1 / 100, 1e-6, glass(1.5)), Surface(-1 / 100, 0.0), aperture=("entrance", 0.2))
    fit = fit_lens(lens, find_reach(lens, height_mm=0.1), degree=3)
    rays = fit.rays_at(D_NM)
    assert fit.pupil_magnification == pytest.approx(1, abs=1e-6)
    _, turned = rays.turn((np.array([1e-4]), np.zeros(1)), (np.zeros(1), np.array([1e-4])), image_distance_m=0.105)
    assert np.abs(turned).max() < 1e-7


def test_rays_that_do_not_pass_are_told_before_anything_is_fitted(double_gauss):
    error = refusal(fit_lens, double_gauss, find_reach(double_gauss, f_number=0.9))
    assert_says(error, "do not pass | --f-number | --height-mm")


REACH = {
    "f_number": (0.0, -2.0, float("nan")),
    "height_mm": (0.0, -1.0, float("inf")),
    "nearest_m": (0.0, 0.1, float("nan")),
}


@pytest.mark.parametrize(("key", "value"), [(key, value) for key, values in REACH.items() for value in values])
def test_a_reach_that_no_lens_has_is_refused(double_gauss, key, value):
    assert_says(refusal(find_reach, double_gauss, **{key: value}), f"--{key.replace('_', '-')}")


def test_light_outside_the_range_of_a_glass_is_refused(tmp_path):
    (tmp_path / "a.zmx").write_text(zemax_text().replace("___BLANK 1 0 1.5168 64.17", "N-SF11 0 0"))
    lens = read_prescription(tmp_path / "a.zmx")
    assert_says(refusal(fit_lens, lens, find_reach(lens, waves_nm=(300.0, 600.0))), "N-SF11 | 300 nm")


def test_a_file_of_a_fit_says_the_same_after_writing_and_reading(tmp_path):
    (tmp_path / "a.zmx").write_text(zemax_text().replace("NAME Singlet", 'NAME A "quoted" \\ lens: ä'))
    lens = read_prescription(tmp_path / "a.zmx")
    fit = fit_lens(lens, find_reach(lens), degree=5, source="a.zmx")
    (tmp_path / "a.yaml").write_text(fitted_text(fit), encoding="utf-8")
    found = read_lens("a.yaml", folder=tmp_path)
    assert found.name == 'A "quoted" \\ lens: ä'
    assert np.array(found.starts) == pytest.approx(np.array(fit.starts), rel=1e-9, abs=1e-12)
    assert found.rays_at(500.0).slopes == pytest.approx(fit.rays_at(500.0).slopes, rel=1e-8, abs=1e-12)


@pytest.mark.parametrize("height_m", [0.0, 4e-3])
def test_the_least_blur_is_that_of_the_traced_spot(double_gauss, height_m):
    """The position of the least rms spot of rays traced through the surfaces: within 0.05 half depths of focus."""
    drive = card(wave_nm=587.5618).build_drive()
    shape, depth_m = (1, 401), 1.0
    target = np.zeros(shape, bool)
    target[0, 200 + round(height_m / PITCH_M)] = True
    criterion = FocusCriterion(drive, PITCH_M)
    found = criterion.least_blur(np.full(shape, depth_m), target)
    low, high = drive.depth_of_focus(found, PITCH_M)
    lens = read_lens("double_gauss")
    n = np.arange(600) + 0.5
    a = drive.aperture_radius_m * np.sqrt(n / 600) * np.stack([np.cos(2.4 * n), np.sin(2.4 * n)])
    spots, tried = [], found + (high - low) / 2 * np.linspace(-2, 2, 41)
    for position in tried:
        v = float(drive.image_distance(position))
        m = drive.pupil_magnification
        behind = Rays(1e3 * m * a, (a - np.array([[height_m], [0]]) / m) / v).at(lens.exit_pupil_mm)
        rays, _ = trace_back(double_gauss, behind, wavelength_nm=587.5618)
        spots.append(rays.at(1e3 * depth_m - lens.entrance_pupil_mm).place.var(axis=1).sum() * v**2)
    k = int(np.argmin(spots))
    parabola = np.polynomial.Polynomial.fit(tried[k - 6 : k + 7], spots[k - 6 : k + 7], 2)
    assert abs(parabola.deriv().roots()[0] - found) < 0.05 * (high - low) / 2


PUBLISHED = {"c_mount": (25.0, 14.0), "double_gauss": (51.6, 37.6), "smartphone": (4.06, 0.485)}
"""Focal length and distance of the focus behind the last surface, as the sources have them, mm."""


def test_every_shipped_lens_has_its_published_numbers_here():
    assert sorted(PUBLISHED) == shipped_lenses()


@pytest.mark.parametrize("name", PUBLISHED)
def test_a_shipped_lens_has_the_focal_length_that_was_published(name):
    """Within 0.5 %, and its focus where the patent has it, within 1 % of the focal length."""
    f, back = PUBLISHED[name]
    lens = read_prescription(LENSES / f"{name}.zmx")
    assert find_pupils(lens, D_NM).focal_length_mm == pytest.approx(f, rel=5e-3)
    rays, _ = trace_forward(lens, parallel(1e-4 * f), wavelength_nm=D_NM)
    assert crossing(rays)[0] == pytest.approx(back, abs=0.01 * f)


@pytest.mark.parametrize("name", PUBLISHED)
def test_a_shipped_lens_bends_rays_as_root_finding_does(name):
    """20 rays (seed 3) through surfaces that another reader read, at 486.1 nm: places within 1e-6 mm."""
    lens, text = read_prescription(LENSES / f"{name}.zmx"), (LENSES / f"{name}.zmx").read_text()
    rng, radius = np.random.default_rng(3), find_pupils(lens, D_NM).entrance_radius_mm(lens.aperture)
    surfaces = surfaces_of(text, wave_um=0.4861327)
    start = Rays(rng.uniform(-0.6, 0.6, (2, 20)) * radius, rng.uniform(-0.15, 0.15, (2, 20)))
    found, _ = trace_forward(lens, start, wavelength_nm=486.1327)
    own = [traced(surfaces, start.place[:, n], start.slope[:, n]) for n in range(20)]
    assert pytest.approx(np.array([place for place, _ in own]), abs=1e-6) == found.place.T
    assert pytest.approx(np.array([slope for _, slope in own]), abs=1e-7) == found.slope.T


@pytest.mark.slow
@pytest.mark.parametrize("name", PUBLISHED)
def test_a_shipped_lens_is_what_its_prescription_gives(name):
    """Made again from its file, with the command that it states: the same rays, within 2e-6 (m, slope)."""
    lens = read_lens(name)
    words = lens.made_with.split()
    stated = dict(zip(words[4::2], words[5::2], strict=True))
    made = read_prescription(LENSES / lens.source, height_mm=float(stated.get("--height-mm", 0)) or None)
    assert find_pupils(made, lens.primary_nm).focal_length_mm == pytest.approx(lens.focal_length_mm, rel=1e-8)
    reach = Reach(lens.radius_mm, lens.height_mm, 1e3 * lens.nearest_m, (D_NM, D_NM))
    again = fit_lens(made, reach, degree=lens.degree)
    radius, height = 0.7e-3 * reach.radius_mm, 0.7e-3 * reach.height_mm
    a, x = radius * np.array([[0.5, -0.3], [0.2, 0.9]]), height * np.array([[0.6, -0.9], [0.2, 0.3]])
    v = 1.03e-3 * lens.focal_length_mm
    found, expected = (
        np.array(one.rays_at(D_NM).turn(tuple(a), tuple(x), image_distance_m=v)) for one in (lens, again)
    )
    assert found == pytest.approx(expected, abs=2e-6)
