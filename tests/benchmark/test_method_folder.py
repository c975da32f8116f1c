"""A folder with a card is one method: it runs as a guest, wherever the name of a method can stand."""

import shutil

import pytest
from planted_sweeps import write_three_sweeps
from refusals import refusal

from saf_gen.benchmark.admission import admit_method, read_methods
from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.method_folder import folder_name
from saf_gen.benchmark.method_spec import TunedMethod, format_tuned, split_halves
from saf_gen.benchmark.records import record_to_json
from saf_gen.leaderboard.tuning import expand_grid

CARD = """name: my net
measure: model.py:Net:weights=weights.txt
search: argmax:window=50
files: [weights.txt]
description: The variance, weighted.
paper: https://example.org
"""
FILES = {
    "method.yaml": CARD,
    "model.py": """
import pathlib, layers
class Net:
    '''Variance of counts, weighted.'''
    source = "nobody"
    score_range = "from 0"
    degree = 2
    def __init__(self, weights=""):
        self.factor = float(pathlib.Path(weights).read_text())
    def __call__(self, counts):
        return float(layers.variance(counts) * self.factor)
""",
    "layers.py": "import numpy as np\ndef variance(counts):\n    return np.var(np.asarray(counts, np.float64))\n",
    "weights.txt": "2",
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_method").mkdir()
    for name, text in FILES.items():
        (tmp_path / "my_method" / name).write_text(text)
    return tmp_path / "my_method"


@pytest.mark.slow
def test_a_folder_gives_the_answers_of_its_files_and_one_digest_wherever_it_lies(folder, tmp_path):
    dataset = write_three_sweeps(tmp_path / "three")
    file = "my_method/model.py:Net:weights=my_method/weights.txt+argmax:window=50"
    shutil.copytree(folder, tmp_path / "a + b @ c" / "moved")
    methods = ["my_method/", "my_method@frame", "a + b @ c/moved/", file]
    records = evaluate(dataset, methods=methods, draw=False).records
    by_name = {
        name: [r for r in records if r.who.method == name] for name in dict.fromkeys(r.who.method for r in records)
    }
    assert list(by_name) == ["my_method/", "a + b @ c/moved/", file, "my_method/@frame"]
    (mine, moved, plain, framed) = by_name.values()
    assert (
        [r.judgement.frame for r in mine]
        == [r.judgement.frame for r in moved]
        == [r.judgement.frame for r in plain]
        != [None] * 3
    )
    assert (
        {r.who.code for r in mine}
        == {r.who.code for r in moved}
        == {r.who.code for r in framed}
        != {r.who.code for r in plain}
    )
    assert mine[0].who.parameters == "my net: Net(weights='weights.txt') + Argmax(window=50, refine='no', near=0.5)"
    assert mine[0].who.limits
    assert record_to_json(mine[0])["note"] == ""


@pytest.mark.slow
def test_a_folder_stands_in_lists_and_tuned_files_if_the_command_line_names_it(folder, tmp_path):
    (tmp_path / "list.txt").write_text("sd+argmax\nmy_method/\n")
    tuned = TunedMethod("my_method/", "small", "train", "recorded", "", "target", 3, "c0ffee", "0.1.0", ())
    (tmp_path / "tuned.json").write_text(format_tuned(tuned))
    assert "names the code" in refusal(read_methods, tmp_path / "list.txt").problem
    assert "names the code" in refusal(admit_method, "@tuned.json").problem
    guest = admit_method("./my_method").guest
    assert read_methods(tmp_path / "list.txt") == ["sd+argmax", "my_method/"]
    assert admit_method("@tuned.json").tuning
    assert "options are in its card" in refusal(expand_grid, "my_method/", {"measure.weights": ["a"]}).problem
    guest.close()


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("my_method", "my_method/"),
        (" my_method// ", "my_method/"),
        ("./my_method/", "./my_method/"),
        ("elsewhere/theirs/", "elsewhere/theirs/"),
        ("a+b/c/", "a+b/c/"),
        ("sd+argmax", ""),
        ("sd", ""),
        ("sd+my_method/search.py:S:folder=my_method/", ""),
        ("elsewhere/theirs", ""),
        ("", ""),
    ],
)
def test_the_name_of_a_folder_ends_in_one_slash(folder, text, name):
    assert folder_name(text) == name
    assert not name or split_halves(name) == [name]


CARDS = [
    (None, "there is no method.yaml in my_method; allowed: a folder with a card is one method"),
    ("", "method.yaml: the file holds no keys; allowed: name, search, measure, files, description, paper"),
    ("name: [", "method.yaml:1: this is not YAML"),
    ("name: a", "'search'"),
    ("search: argmax", "'name'"),
    (CARD + "weight: 3\n", "'weight'"),
    (CARD + "name: b\n", "given twice"),
    (CARD.replace("my net", "a+b"), "method.yaml:1: "),
    (CARD.replace("my net", "3"), "method.yaml:1: "),
    (CARD.replace("[weights.txt]", "weights.txt"), "method.yaml:4: "),
    (CARD.replace("[weights.txt]", "[weight.txt]"), "method.yaml:4: 'weight.txt' is not in my_method; allowed: its"),
    (CARD.replace("[weights.txt]", "[../weights.txt]"), "'../weights.txt' is outside my_method"),
    (CARD.replace("[weights.txt]", "[.]"), "'.' is a folder"),
    (CARD.replace("model.py:Net", "modul.py:Net"), "'modul.py' is not in my_method"),
    (CARD.replace("model.py:Net", "/etc/model.py:Net"), "'/etc/model.py' is outside my_method"),
    (CARD.replace("model.py:Net", "os.path:join"), "the measure is 'os.path:join'; allowed: file.py:Name of a file"),
    (CARD.replace("model.py:Net:weights=weights.txt", "model.py"), "the measure is 'model.py'; allowed: file.py:Name"),
    (CARD.replace("model.py:Net", "model.py:Nett"), "model.py has no 'Nett'"),
    (CARD.replace("argmax:window=50", "argmin"), "unknown search 'argmin'"),
    (CARD.replace("window=50", "window"), "malformed option 'window'"),
    (CARD.replace("window=50", "windows=50"), "'windows'"),
]  # fmt: skip


@pytest.mark.parametrize(("card", "words"), CARDS)
def test_a_bad_card_is_refused_in_one_line(folder, card, words):
    if card is None:
        (folder / "method.yaml").unlink()
    else:
        (folder / "method.yaml").write_text(card)
    line = str(refusal(admit_method, "my_method/"))
    assert words in line
    assert "\n" not in line


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ("nowhere/", "nowhere does not exist; allowed: a folder with a method.yaml"),
        ("my_method/model.py/", "my_method/model.py is a file"),
        ("my_method/method.yaml", "name its folder: my_method/"),
        ("my_method/+argmax", "unknown focus measure 'my_method/'"),
    ],
)
def test_what_is_no_folder_of_a_method_is_refused_in_one_line(folder, spec, words):
    assert words in str(refusal(admit_method, spec))


@pytest.mark.slow
def test_the_command_checks_a_folder(folder, call):
    code, out, err = call("methods", "check", "my_method/")
    assert (code, err) == (0, "")
    assert "0 fail" in out
    assert "Variance of counts" in call("methods", "show", "my_method/")[1]
