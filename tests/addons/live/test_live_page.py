"""The page of a live camera: what its server answers and to whom, and what somebody sees who turns the knob."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from contextlib import contextmanager

import numpy as np
import pytest
from browser import CHROMIUM, NO_CHROMIUM, run_at

from saf_gen.addons.live.camera import LiveCamera
from saf_gen.addons.live.server import LiveRoom, LiveServer


@contextmanager
def serve(capture, **options):
    room = LiveRoom(LiveCamera(capture, **options))
    with LiveServer(room, 0) as server:
        threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
        yield server
        room.stop_method()
        server.shutdown()


@pytest.fixture
def server(still):
    with serve(still) as made:
        yield made


def ask(server, path="picture", body=b"{}", address=None, **headers):
    """Return status and body of the answer to a request."""
    data = body if isinstance(body, bytes) or body is None else json.dumps(body).encode()
    request = urllib.request.Request((address or server.address) + path, data=data, headers=headers)
    try:
        with urllib.request.urlopen(request, timeout=60) as answer:
            return answer.status, answer.read()
    except urllib.error.HTTPError as refused:
        return refused.code, refused.read()


def see(server, **asked):
    """Return the head and the grey values of the next picture."""
    status, body = ask(server, body=asked)
    assert status == 200, body
    length = int.from_bytes(body[:4], "little")
    head = json.loads(body[4 : 4 + length])
    return head, np.frombuffer(body[4 + length :], np.uint8).reshape(head["rows"], head["columns"])


def test_a_picture_follows_the_commands_that_come_with_it(server):
    head, grey = see(server, focus=0.9, window=100)
    camera = server.room.camera
    assert (head["rows"], head["columns"]) == camera.shape
    assert head["focus"] == 0.9
    assert head["frames"] == 100
    assert len(head["scores"]) == 3
    while abs(head["lens"] - 0.9) > 0.01:
        head, grey = see(server)
    later, dim = see(server, lamps={"lamp": 0.1, "room": 0.1}, measures=["sd"])
    assert dim.mean() < 0.7 * grey.mean()
    assert later["seconds"] > head["seconds"]
    assert len(later["scores"]) == 1
    frame, grey = see(server, region="frame")
    assert grey.shape == (camera.capture.sensor.rows, camera.capture.sensor.columns)
    assert see(server, light="flicker")[0]["rows"] == frame["rows"]


def test_time_goes_on_as_on_the_wall_but_not_while_nobody_looks(server):
    first, begun = see(server)[0], time.perf_counter()
    for _ in range(20):
        last = see(server)[0]
    passed = time.perf_counter() - begun
    assert 0 < last["seconds"] - first["seconds"] < passed + 0.05
    time.sleep(0.6)
    assert see(server)[0]["seconds"] - last["seconds"] < 0.3
    slow, begun = see(server, pace=0.1, window=50)[0], time.perf_counter()
    for _ in range(10):
        last = see(server, window=50)[0]
    assert last["seconds"] - slow["seconds"] < 0.1 * (time.perf_counter() - begun) + 0.01


@pytest.mark.slow
def test_a_method_runs_when_asked_and_can_be_stopped(server):
    assert ask(server, "method", {"name": "sd+golden_section"})[0] == 200
    assert ask(server, "method", {"name": "sd+golden_section"}) == (
        400, b'{"error": "a method is running already; wait until it has ended, or stop it"}'
    )  # fmt: skip
    while (head := see(server, focus=0.1)[0])["running"]:
        assert "is looking for the focus" in head["said"]
    assert re.fullmatch(
        r"sd\+golden_section: lens at 0\.\d{4}, [+-]\d\.\d\d depths of focus from the true focus, "
        r"after \d+ ms and \d+ windows",
        head["said"],
    )
    assert see(server, pace=0.001, window=1)[0]["running"] is False
    assert ask(server, "method", {"name": "sd+hill_climb"})[0] == 200
    assert ask(server, "stop")[0] == 200
    assert see(server, pace=1)[0]["said"] == "sd+hill_climb was stopped"


@pytest.mark.parametrize(
    ("path", "body", "problem"),
    [
        ("picture", {"focus": 2}, "focus is 2; allowed: 0 to 1"),
        ("picture", {"focus": "x"}, "not supported"),
        ("picture", {"measures": ["sdd"]}, "unknown focus measure 'sdd'"),
        ("picture", {"window": 0}, "a window of 0 readouts"),
        ("picture", {"pace": 7}, "the pace is 7"),
        ("picture", {"light": "disco"}, "unknown light 'disco'"),
        ("picture", {"lamps": 3}, "not iterable"),
        ("picture", b"[1]", "not an object"),
        ("picture", b"{", "Expecting"),
        ("method", {"name": "own.py:Measure+argmax"}, "unknown method"),
    ],
)
def test_a_request_that_is_not_allowed_is_told_so_and_the_page_goes_on(server, path, body, problem):
    status, answer = ask(server, path, body)
    assert status == 400
    assert problem in json.loads(answer)["error"]
    assert see(server)[0]["rows"] > 0


def test_the_page_of_a_camera_of_photons_offers_what_suits_photons(still, photons):
    measure, method = '"sd_calibrated"', '"structure_calibrated+photon_aware"'
    for capture, offered in ((still, True), (photons, False)):
        with serve(capture) as server:
            page = ask(server, "", None)[1].decode()
            assert [name in page for name in (measure, method, '"sd_code+egs_code"')] == [offered, offered, True]
            status, answer = ask(server, "picture", {"measures": ["sd_calibrated"]})
            assert (status == 200) == offered
    assert "corrects for the noise of spikes" in json.loads(answer)["error"]


def test_only_the_reader_of_the_address_is_answered_and_only_by_this_name(server):
    bare = f"http://127.0.0.1:{server.server_port}/"
    assert server.server_address[0] == "127.0.0.1"
    assert ask(server, "", None)[0] == 200
    for address in (bare, f"{bare}{'A' * 22}/", bare + server.token):
        assert ask(server, "", None, address)[0] == 404
        assert ask(server, "picture", b"{}", address)[0] == 404
    assert ask(server, "other", None)[0] == 404
    assert ask(server, "other")[0] == 404
    assert ask(server, Host=f"localhost:{server.server_port}")[0] == 200
    forwarded = "localhost:9"  # a port of another machine that leads here
    assert ask(server, Host=forwarded, Origin=f"http://{forwarded}")[0] == 200
    for headers in (
        {"Host": "evil.example"},  # a name that resolves to this machine
        {"Host": f"evil.example:{server.server_port}"},
        {"Host": "localhost.evil.example"},
        {"Origin": "http://evil.example"},  # a page that guesses the address
        {"Host": forwarded, "Origin": "http://localhost:10"},
    ):
        status, why = ask(server, **headers)
        assert (status, why.decode()) == (
            403, "This camera answers only pages of 127.0.0.1 and localhost: open the address it printed.\n"
        )  # fmt: skip
    assert b"open the address that saf-gen live printed" in ask(server, "other")[1]
    assert ask(server, body=b" " * (1 << 17))[0] == 400


@pytest.mark.parametrize("half", [b"POST /", b"POST / HTTP/1.1\r\nHost: localhost\r\n", b""])
def test_half_a_request_is_not_waited_for(server, monkeypatch, half):
    monkeypatch.setattr("saf_gen.addons.live.server._Handler.timeout", 0.1)
    with socket.create_connection(server.server_address, timeout=60) as connection:
        connection.sendall(half)
        assert connection.recv(1) == b""  # it is closed


def test_a_body_that_does_not_come_is_not_waited_for(server, monkeypatch):
    monkeypatch.setattr("saf_gen.addons.live.server._Handler.timeout", 0.1)
    with socket.create_connection(server.server_address, timeout=60) as connection:
        head = f"POST /{server.token}/picture HTTP/1.1\r\nHost: localhost\r\nContent-Length: 9\r\n\r\n{{"
        connection.sendall(head.encode())
        assert connection.recv(1) == b""


# --- in a browser --------------------------------------------------------------------------------------

TURN = """
const wait = (ms) => new Promise((done) => setTimeout(done, ms));
const get = (id) => document.getElementById(id);
const pictures = () => Number(document.body.dataset.pictures ?? 0);
const more = async (count) => { const before = pictures(); while (pictures() < before + count) await wait(10); };
const turn = async (id, value) => {
  get(id).value = value;
  get(id).dispatchEvent(new Event("input", { bubbles: true }));
  await more(3);
};
const picture = () => {
  const canvas = get("picture");
  const colours = [...canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data];
  return colours.filter((_, n) => n % 4 === 0);
};
const mean = (values) => values.reduce((a, b) => a + b, 0) / values.length;
const contrast = () => {
  const values = picture(), level = mean(values);
  return Math.sqrt(mean(values.map((value) => (value - level) ** 2))) / level;
};
await more(2);
"""


@pytest.mark.browser
@pytest.mark.skipif(CHROMIUM is None, reason=NO_CHROMIUM)
def test_turning_the_knob_changes_the_picture_and_the_score(server):
    camera = server.room.camera
    seen = run_at(
        server.address,
        TURN
        + f"""
        const settled = async (to) => {{
          await turn("focus", to);
          const at = () => Number(get("where").textContent.match(/at ([\\d.]+)/)[1]);
          while (Math.abs(at() - to) > 0.02) await more(1);
          await more(2);
          return contrast();
        }};
        const far = await settled(1), near = await settled({round(camera.true_focus, 3)});
        get("focus").focus();
        const before = get("where").textContent;
        const bright = mean(picture());
        for (const slider of document.querySelectorAll("#lamps input")) {{
          slider.value = -3;
          slider.dispatchEvent(new Event("input", {{ bubbles: true }}));
        }}
        await more(4);
        const dim = mean(picture());
        const unseen = get("mark").hidden;
        get("reveal").click();
        await more(2);
        get("picture").dispatchEvent(new WheelEvent("wheel", {{ deltaY: 1, cancelable: true }}));
        const turned = Number(get("focus").value);
        await turn("region", "frame");
        const size = [get("picture").width, get("picture").height];
        const all = document.documentElement.scrollHeight <= window.innerHeight;
        return {{ far, near, bright, dim, unseen, all, revealed: get("where").textContent, turned, size,
          legend: [...document.querySelectorAll(".u-legend .u-value")].map((value) => value.textContent),
          spelled: get("spelled").textContent, title: document.title,
          problem: get("problem").textContent, lines: document.querySelectorAll("#plot canvas").length,
          speed: get("speed").textContent }};
        """,
    )
    assert seen["near"] > 1.05 * seen["far"]
    assert seen["dim"] < 0.6 * seen["bright"]
    assert seen["unseen"] is True
    assert f"true focus {camera.true_focus:.3f}" in seen["revealed"]
    assert seen["turned"] == pytest.approx(round(camera.true_focus, 3) - 0.005, abs=1e-9)
    assert seen["size"] == [camera.capture.sensor.columns, camera.capture.sensor.rows]
    assert seen["all"] is True  # picture, chart and knobs are in the window
    assert seen["problem"] == ""
    assert seen["lines"] == 1
    assert len([float(value) for value in seen["legend"]]) == 5  # time, three scores, lens: those of now
    assert seen["spelled"] == "sd: spike dispersion; golden_section: golden section search"
    assert seen["title"] == f"Live spike camera: {camera.capture.plane_source.time_stack.specs[0].scene}"
    assert re.fullmatch(r"\d+\.\d\d × real time; possible: [\d,]+ readouts/s, \d+\.\d\d ×", seen["speed"])


@pytest.mark.browser
@pytest.mark.skipif(CHROMIUM is None, reason=NO_CHROMIUM)
def test_a_phone_in_the_dark_runs_a_method(server):
    seen = run_at(
        server.address,
        TURN
        + """
        const root = document.documentElement, right = document.querySelector("main").getBoundingClientRect().right;
        const narrow = root.scrollWidth <= root.clientWidth && right <= root.clientWidth - 15;
        get("method").value = "sd+hill_climb";
        get("run").click();
        while (!get("focus").disabled) await wait(5);
        while (get("focus").disabled) await wait(20);
        await more(1);
        return { narrow, paper: getComputedStyle(document.body).backgroundColor, said: get("said").textContent };
        """,
        width=390,
        dark=True,
    )
    assert seen["narrow"] is True
    assert seen["paper"] == "rgb(20, 23, 27)"
    assert seen["said"].startswith("sd+hill_climb: ")


# --- the command ---------------------------------------------------------------------------------------


@contextmanager
def started(*words):
    """Start the command in a process of its own; yield it and its first line."""
    run = "from saf_gen.cli import main; main()"
    process = subprocess.Popen(
        [sys.executable, "-c", run, "live", *map(str, words), "--no-browser"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )  # fmt: skip
    try:
        yield process, process.stdout.readline()
    finally:
        process.kill()
        process.communicate()


@pytest.mark.slow
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 0), (signal.SIGTERM, 143)])
def test_the_command_prints_the_address_and_ends_when_told(captured_dataset, number, code):
    with started(captured_dataset) as (process, line):
        address = re.fullmatch(r"(http://127\.0\.0\.1:\d+/[\w-]{22}/)   \(Ctrl-C ends it\)\n", line)[1]
        with urllib.request.urlopen(address, timeout=60) as page:
            assert b"<title>Live spike camera: " in page.read()
        process.send_signal(number)
        out, err = process.communicate(timeout=60)
        assert (process.returncode, out) == (code, "")
        assert "Traceback" not in err


def test_a_port_that_is_taken_and_a_wrong_scene_are_one_line(captured_dataset, call):
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        code, out, err = call("live", captured_dataset, "--port", port)
    assert (code, out) == (2, "")
    assert err.startswith(f"saf-gen: port {port} cannot be used: Address already in use; allowed: a free port")
    assert err.count("\n") == 1
    code, out, err = call("live", "usaf_taget")
    assert (code, err.count("\n")) == (2, 1)
    assert "did you mean 'usaf_target'" in err
