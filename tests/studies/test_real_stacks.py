"""Real stacks as a judged track, on pictures made here: the rule of truth, families, classes, boxes, and one run."""

import json
from dataclasses import replace

import numpy as np
import pytest
import tifffile
import yaml
from handmade_records import record as make_record
from scipy.ndimage import gaussian_filter

import saf_gen
from saf_gen.stream.manifest import read_manifest
from studies.real_stacks import dataset
from studies.real_stacks.__main__ import judge_again, main
from studies.real_stacks.dataset import FILES, SIDE, SOURCES, Source, choose_boxes, count_other_files, read_sources
from studies.real_stacks.truth import MEASURES, BoxTruth, box_truth, families_of, focus_curve, peak, share_in_focus

SOURCE = Source(grade="A", title="dots", licence="CC0-1.0", source="https://example.org/dots", pictures=12)


def blurred(peak, *, count=12, growth=1.5, size=SIDE, seed=5):
    """A texture, float32 (focus, row, col), under a Gaussian blur whose variance is a parabola about the peak."""
    flat = gaussian_filter(np.random.default_rng(seed).random((size, size)), 1.0)
    flat = 0.1 + (flat - flat.min()) / np.ptp(flat)
    return np.stack([gaussian_filter(flat, np.hypot(0.5, growth * (k - peak))) for k in range(count)]).astype("f4")


@pytest.mark.parametrize("focus", [5.0, 5.2, 5.35, 5.5])
@pytest.mark.parametrize(
    ("growth", "count", "narrow"), [(0.9, 12, True), (0.35, 12, False), (0.06, 60, False)], ids=["2", "5", "wide"]
)
def test_the_truth_is_where_the_blur_is_least(focus, growth, count, narrow):
    """Within 0.05 pictures, for narrow peaks, usual ones, and ones that are fitted."""
    focus += count // 2 - 6
    found = box_truth(blurred(focus, count=count, growth=growth, size=64))
    assert (found.width < 3) == narrow
    assert (found.width > 15) == (count == 60)
    assert found.without() == pytest.approx(focus, abs=0.05)
    assert found.uncertainty >= max(0.03, np.ptp(list(found.peaks.values())))


def test_a_picture_that_is_too_sharp_moves_a_wide_peak_little():
    """One of 60 pictures has 5 % more contrast near the peak, which moves the parabola through three values far."""
    pictures = blurred(29.4, count=60, growth=0.06, size=64)
    pictures[31] = pictures[31].mean() + 1.05 * (pictures[31] - pictures[31].mean())
    curve = focus_curve("tenengrad", pictures)
    assert abs(peak(curve, width=3.0) - 29.4) > 1.2
    assert peak(curve, width=20.0) == pytest.approx(29.4, abs=0.4)


def test_a_focus_beyond_the_pictures_is_no_truth():
    assert box_truth(blurred(-3)) is None
    assert box_truth(np.full((9, SIDE, SIDE), 0.5, np.float32)) is None
    assert box_truth(np.zeros((9, SIDE, SIDE), np.float32)) is None


def test_pictures_that_half_of_the_stack_does_not_have_make_a_truth_less_sure():
    narrow, usual = (box_truth(blurred(5.3, growth=growth)) for growth in (2.0, 0.35))
    assert narrow.uncertainty > 2 * usual.uncertainty


@pytest.mark.parametrize(
    ("method", "families"),
    [
        ("sd_code+egs_code", set()),
        ("vollath_f4_n+argmax:window=300", {"autocorrelation"}),
        ("octave_structure+argmax", {"autocorrelation"}),
        ("tenengrad_tfi+argmax", {"gradient"}),
        ("tenengrad_n+elp", {"gradient", "laplacian"}),
        ("fine_structure+bell_vote", {"autocorrelation"}),
        ("sd+bell_vote:area=true", {"autocorrelation"}),
    ],
)
def test_a_method_belongs_to_the_families_of_its_measure_and_its_search(method, families):
    assert families_of(method) == families


def test_a_family_leaves_the_truth_that_judges_it_and_a_given_truth_stays():
    truth = BoxTruth({"gradient": 4.0, "autocorrelation": 6.0, "laplacian": 4.4, "spectrum": 4.2}, 3.0, 2.0)
    assert truth.without() == pytest.approx(4.3)
    assert truth.without({"autocorrelation"}) == pytest.approx(4.2)
    assert truth.without({"gradient", "laplacian", "spectrum"}) == pytest.approx(6.0)
    assert truth.without(MEASURES) is None
    assert replace(truth, given=5.0).without(MEASURES) == 5.0


def test_a_record_is_judged_by_the_truth_that_its_family_leaves():
    peaks = {"gradient": 4.0, "autocorrelation": 6.0, "laplacian": 4.4, "spectrum": 4.2}
    facts = {"a": {"pictures": 11, "truth": {"peaks": peaks, "width": 3.0, "uncertainty": 2.0}}}
    own = {"vollath_f4+argmax": 0.42, "sd+argmax": 0.43}
    records = [make_record(m, "a", 0.0, position=0.43, truth=0.9, depth_of_focus=0.1) for m in own]
    judged = judge_again(records, facts)
    assert {record.who.method: pytest.approx(record.judgement.truth) for record in judged} == own
    assert [record.success() for record in [*records, *judged]] == [False, False, True, True]


def test_a_box_is_of_one_depth_if_most_of_its_blocks_peak_at_its_truth():
    """The left part of a picture focuses at 3 and the right at 8: the share is that of the part at the truth."""
    near, far = blurred(3.0, growth=0.6), blurred(8.0, growth=0.6, seed=6)
    for columns in (32, 96):
        both = np.concatenate([near[:, :, :columns], far[:, :, columns:]], axis=2)
        assert share_in_focus(both, 3.0, 1.0) == pytest.approx(columns / SIDE, abs=0.1)
        assert share_in_focus(both, 8.0, 1.0) == pytest.approx(1 - columns / SIDE, abs=0.1)


@pytest.mark.slow
def test_boxes_are_those_of_the_rule_and_repeat():
    """A row of boxes above a seam and one below, whose focus differs; one box is beyond the pictures, one is flat."""
    peaks = {(0, 0): 6.3, (0, 1): 4.1, (0, 2): -4.0, (140, 0): 7.2, (140, 1): 3.3, (140, 2): None}
    light = np.full((12, 140 + SIDE, 3 * SIDE), 0.5, np.float32)
    for (top, n), at in peaks.items():
        if at is not None:
            light[:, top : top + SIDE, n * SIDE : (n + 1) * SIDE] = blurred(at, growth=0.6, seed=n)
    source = SOURCE.model_copy(update={"seams": (140,)})
    boxes = choose_boxes(light, source)
    assert [(box.top, box.left // SIDE) for box in boxes] == [(140, 1), (0, 1), (0, 0), (140, 0)]
    assert [box.best for box in boxes] == pytest.approx([3.3, 4.1, 6.3, 7.2], abs=0.05)
    assert [(b.top, b.left, b.best, b.unit, b.share) for b in choose_boxes(light, source)] == [
        (b.top, b.left, b.best, b.unit, b.share) for b in boxes
    ]
    assert {box.unit for box in boxes} == {1.1}  # a tenth of the travel
    assert [(b.top, b.left // SIDE) for b in choose_boxes(light, source, count=2)] == [(140, 1), (140, 0)]
    assert choose_boxes(light[:, : SIDE - 1], SOURCE) == []


def test_the_list_of_sources_and_the_digests_agree():
    listed = FILES.read_text().splitlines()
    for name in yaml.safe_load(SOURCES.read_text()):
        (source,) = read_sources(SOURCES, [name]).values()
        assert sum(line.split()[1].startswith(f"{name}/") for line in listed) == source.pictures
        assert source.source.startswith("https://")
        assert source.licence
    assert {source.grade for source in read_sources(SOURCES).values()} == {"A", "B"}


@pytest.fixture
def stacks(tmp_path):
    """Pictures of two objects, and a list of four of which one is not ranked and one is not there."""
    listed = {}
    for name, grade, focus in (("dots", "A", 5.3), ("grain", "B", 4.4), ("dust", "C", 6.1), ("gone", "A", 5)):
        listed[name] = {"grade": grade, "title": name, "licence": "CC0-1.0", "source": f"https://example.org/{name}"}
        listed[name] |= {"pictures": 12, "transfer": "linear"}
        if name != "gone":
            (tmp_path / "pictures" / name).mkdir(parents=True)
            for k, picture in enumerate(blurred(focus, growth=0.6)):
                tifffile.imwrite(tmp_path / "pictures" / name / f"{k}.tif", (40_000 * picture).astype(np.uint16))
    (tmp_path / "sources.yaml").write_text(yaml.safe_dump(listed))
    return tmp_path


def run(folder, *options):
    main([str(folder / "pictures"), "--out", str(folder / "out"), "--sources", str(folder / "sources.yaml"), *options])


@pytest.mark.parametrize(
    ("options", "said"),
    [([], "no pictures of gone in | 12: all of https://example.org/gone"), (["--object", "dot"], "dot | dots")],
)
def test_an_object_that_is_missing_is_one_line_that_names_its_source(stacks, capsys, options, said):
    with pytest.raises(SystemExit) as ended:
        run(stacks, *options)
    (line,) = capsys.readouterr().err.splitlines()
    assert ended.value.code == 2
    assert all(part in line for part in said.split(" | "))
    assert not (stacks / "out").exists()


def test_a_picture_that_is_missing_or_another_is_noticed(stacks, capsys):
    (stacks / "pictures/dots/3.tif").unlink()
    with pytest.raises(SystemExit):
        run(stacks, "--object", "dots")
    assert "11 pictures of dots in" in capsys.readouterr().err
    files = sorted((stacks / "pictures/grain").iterdir())
    (stacks / "files.sha256").write_text(f"{dataset.file_sha256(files[0])}  grain/{files[0].name}\n")
    assert count_other_files(files, stacks / "files.sha256") == 11
    assert count_other_files(files, stacks / "none.sha256") == 0


@pytest.mark.slow
def test_stacks_become_a_dataset_on_which_methods_rank(stacks, capsys, monkeypatch):
    monkeypatch.setattr(dataset, "FRAMES", 2400)
    options = [word for name in ("dots", "grain", "dust") for word in ("--object", name)]
    options += ["-m", "vollath_f4_n+argmax", "-m", "sd+argmax"]
    run(stacks, *options)
    printed = capsys.readouterr().out
    manifest = read_manifest(stacks / "out")
    assert {(entry.scene, entry.split) for entry in manifest.sequences} == {
        ("dots", "one_depth"), ("grain", "one_depth"), ("dust", "grade_c")
    }  # fmt: skip
    assert len({entry.light for entry in manifest.sequences}) == 4
    entry = manifest.sequences[0]
    with saf_gen.open_stream(stacks / "out" / entry.file) as stream:
        facts = json.loads(stream.metadata.provenance["real_stack"])
        assert stream.truth.position * 11 == pytest.approx(5.3, abs=0.05)
        assert np.ptp(stream.truth.depth_of_focus) * 11 == pytest.approx(facts["unit_pictures"])
        assert stream.focus_position[round(stream.truth.frame)] == pytest.approx(stream.truth.position, abs=1e-3)
        counts = stream.counts(0, 2400)
        assert counts.mean() / 2400 == pytest.approx(0.1, rel=0.1)
    sharp = blurred(5.3, growth=0.6)[4:8].mean(axis=0)
    assert np.corrcoef(counts.ravel(), sharp.ravel())[0, 1] > 0.5
    records = [json.loads(line) for line in (stacks / "out/evaluation/records.jsonl").read_text().splitlines()]
    assert {record["scene"] for record in records} == {"dots", "grain"}
    assert printed.count("| grade_c | 1 (1) |") == 2
    board = saf_gen.evaluate(stacks / "out", ["sd+argmax"], split="one_depth")
    assert board[0].answerable == 8
    with pytest.raises(SystemExit):
        run(stacks, "--object", "dots")
    assert "is another dataset" in capsys.readouterr().err
