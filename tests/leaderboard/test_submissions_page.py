"""The page of all submissions: ranked in comparable groups, dated, and nothing in untrusted folders is run."""

import json
import re
from html.parser import HTMLParser

import pytest
from handmade_records import record

from saf_gen.benchmark.records import write_records
from saf_gen.leaderboard import verification
from saf_gen.leaderboard.submission import create_submission, list_submissions
from saf_gen.leaderboard.verification import RowVerdict, Verification, digest_leaderboard_answers

BITES = "<script>alert(1)</script>|[x](javascript:alert(1))\u202e"


def hand_in(folder, *, errors=(0.2, 0.4, 3.0), answers=True, **card):
    """Write a submission of a method in a file, with an answer to one sequence of each of some scenes."""
    text = create_submission(folder).read_text()
    stated = {"title": "A title", "authors": ["Ada Lovelace"], "licence": "MIT", "date": "2026-11-22"}
    for key, value in {**stated, "method": "method.py:Mine+argmax", **card}.items():
        line = f"{key}: {json.dumps(value)}"
        text, found = re.subn(rf"^{key}: .*$", lambda _, line=line: line, text, flags=re.MULTILINE)
        assert found == 1
    (folder / "submission.yaml").write_text(text.replace(": false", ": true"))
    (folder / "method.py").write_text("open('ran', 'w')\n\ndef Mine(window):\n    return 0.0\n")
    if answers:
        own = [record("x/method.py:Mine+argmax", f"s{n}", e, scene=f"scene{n}") for n, e in enumerate(errors)]
        write_records(folder / "evaluation/records.jsonl", own)
        return own
    return []


def verify(folder, own, state="re-run here"):
    verdict = RowVerdict(own[0].method, state, "", digest_leaderboard_answers(own))
    here = verification.socket.gethostname(), verification.describe_machine()
    found = Verification((verdict,), "bench", *here, "1")
    return verification.write_leaderboard_verification(folder / "evaluation", found)


@pytest.fixture
def folder(tmp_path):
    folder = tmp_path / "handed in"
    verify(folder / "best", hand_in(folder / "best", errors=(0.1, 0.2, 0.3), date="2026-11-20"))
    verify(folder / "forged", hand_in(folder / "forged"), "differs")
    hand_in(folder / "bites", errors=(0.1, 4.0, 3.0), title=BITES, authors=[BITES], url="javascript:alert(1)")
    hand_in(folder / "fewer", errors=(0.1, 0.1))
    hand_in(folder / "waits", answers=False, url="https://example.org/paper?a=1&b=2")
    return folder


class Read(HTMLParser):
    """The links, number of scripts, table cells and text of a page."""

    def __init__(self, text):
        super().__init__()
        self.links, self.scripts, self.rows, self.text = [], 0, [], ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.scripts += tag == "script"
        if tag == "a":
            self.links.append(dict(attrs)["href"])
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")

    def handle_data(self, data):
        self.text += data
        if self.rows and self.rows[-1] and self.lasttag in ("td", "th", "a"):
            self.rows[-1][-1] += data.strip()


def test_submissions_are_ranked_with_those_that_answered_the_same(folder):
    listed = list_submissions(folder)
    tables = [[one.name for one in table.submissions] for table in listed.tables]
    assert tables == [["best", "forged", "bites"], ["fewer"]]
    assert [row.success_1dof for row in listed.tables[0].rows] == pytest.approx([1, 2 / 3, 1 / 3])
    assert [one.name for one in listed.unanswered] == ["waits"]
    states = {one.name: one.state for one in listed.submissions}
    claimed = {"bites": "claimed", "fewer": "claimed", "waits": "no answers"}
    assert states == {"best": "re-run here", "forged": "differs", **claimed}


def test_answers_to_other_data_stand_in_a_table_of_their_own(folder):
    own = [record("method.py:Mine+argmax", f"s{n}", 0.1, scene=f"scene{n}", data="others") for n in range(3)]
    write_records(folder / "best/evaluation/records.jsonl", own)
    names = [[one.name for one in table.submissions] for table in list_submissions(folder).tables]
    assert ["best"] in names
    assert ["forged", "bites"] in names


def test_the_page_shows_dates_and_rows_and_links_to_cards(call, folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, err = call("submit", "page", folder, "--out", tmp_path / "site")
    assert (code, err) == (0, "")
    assert "best: re-run here, 2026-11-20" in out
    page = Read((tmp_path / "site/index.html").read_text())
    assert page.rows[1][:5] == ["1", "best", "100%", "re-run here", "2026-11-20"]
    assert page.rows[2][1:4] == ["forged", "67%", "differs"]
    assert "../handed%20in/best/submission.yaml" in page.links
    assert "https://example.org/paper?a=1&b=2" in page.links
    assert "5 submissions: 1 re-run here, 1 differs, 2 claimed, 1 no answers" in page.text
    assert "verified: answers differ when the method is run again" in page.text
    assert not (tmp_path / "ran").exists()
    markdown = (tmp_path / "site/submissions.md").read_text()
    assert "| 1 | [best](../handed%20in/best/submission.yaml) | A title | Ada Lovelace | 2026-11-20 | MIT |" in markdown
    assert "## Without answers" in markdown


def test_texts_that_bite_are_shown_as_they_are(call, folder):
    assert call("submit", "page", folder)[0] == 0
    text = (folder / "index.html").read_text()
    page = Read(text)
    assert page.scripts == 1
    assert "<script>alert(1)</script>|[x](javascript:alert(1))\\u202e" in page.text
    assert not [link for link in page.links if link.startswith("javascript")]
    assert "\u202e" not in text
    markdown = (folder / "submissions.md").read_text()
    assert "<script" not in markdown
    assert r"\|\[x\](javascript:alert(1))\\u202e" in markdown


def test_a_card_that_cannot_be_read_is_named_and_the_others_are_shown(call, folder, tmp_path):
    (folder / "waits/submission.yaml").write_text("name: [\n")
    code, out, err = call("submit", "page", folder)
    assert (code, err.count("\n")) == (1, 1)
    assert "waits is not shown: " in err
    assert "best: re-run here" in out
    assert "Not shown, because the card cannot be read" in (folder / "index.html").read_text()
    (tmp_path / "nothing").mkdir()
    code, out, err = call("submit", "page", tmp_path / "nothing")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "holds no submission" in err


def test_damaged_records_are_no_answers(folder):
    (folder / "best/evaluation/records.jsonl").write_text("{}\n")
    (best,) = (one for one in list_submissions(folder).submissions if one.name == "best")
    assert (best.state, best.records) == ("no answers", ())
    assert any(text.startswith("answers: ") for text in best.to_do)
