"""The page of a live camera, on this machine only: its server, and what a request turns and shows.

Only requests to the loopback address that know the random word in the address are answered, and only if they name the
loopback address as their host, so that no other page in the browser, and no other name that resolves to this machine,
reaches it. Any port will do, because somebody may forward one from another machine.
"""

import hmac
import json
import secrets
import threading
import time
from collections.abc import Mapping
from html import escape
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from typing import Any, ClassVar
from urllib.parse import urlsplit

import numpy as np

from saf_gen.addons.live.camera import MAX_READ_FRAMES, REGIONS, LiveCamera
from saf_gen.benchmark.method_spec import DEFAULT_CLOSED_LOOP_METHODS, parse_method
from saf_gen.camera.exposure import firing_rate
from saf_gen.camera.photons.sensor import SpadSensor, detection_rate
from saf_gen.core.display_tone import display_gamma, white_level
from saf_gen.errors import BadInput, SafGenError, unknown
from saf_gen.leaderboard.results import spell_out_names
from saf_gen.plugins.measures import measure_names

MEASURES = ("sd", "gradient_code_n", "mfdct_lee_n")
"""Measures that the page draws at first."""
SCHEDULES: dict[str, dict[str, Any] | None] = {
    "constant": None,
    "flicker": {"kind": "flicker", "hz": 100.0, "depth": 0.8},
    "steps": {"kind": "steps", "every_s": 0.25, "levels": [1.0, 0.4, 2.0]},
    "ramp": {"kind": "ramp", "from": 0.3, "to": 3.0},
}
"""Light schedules that the page offers."""
WINDOW = 200
SCHEDULE_S = 3.0
METHOD_S = 1.0
"""Time of the camera that a method has, in seconds."""
LONGEST_STEP_S = 0.2
"""Longest time that passes for the camera between two pictures, such as after the page was hidden."""
COMPUTING_S = 0.04
"""Computing time of a picture that a slow machine is allowed; the camera is then slower than real time."""
MAX_BODY = 1 << 16
HOSTS = ("127.0.0.1", "localhost")
NOTHING_HERE = "Nothing is here: open the address that saf-gen live printed, with all its letters."


class Stopped(Exception):
    """Somebody has stopped the method that was running."""


class LiveRoom:
    """A live camera and the clock on the wall: each picture is as much later as the wall clock says.

    Parameters
    ----------
    camera : LiveCamera
        The camera.
    """

    def __init__(self, camera: LiveCamera) -> None:
        self.camera = camera
        self._turn = threading.Lock()
        self._before, self._due = time.perf_counter(), 0.0
        self._readouts_per_s = camera.readout_hz
        self._clock = (self._before, camera.seconds)
        self._factor = 1.0
        self._pace = 1.0
        self._light = "constant"
        self._method: threading.Thread | None = None
        self._stop = threading.Event()
        self._said = ""
        truth, sensor = camera.true_focus, camera.capture.sensor
        in_focus = camera.nominal_charge(truth if np.isfinite(truth) else 0.5)
        self._white = white_level(_mean_rate(in_focus, sensor))
        """Spikes per readout that are shown as white: of the brightest pixels, in focus, with all lamps at gain 1."""

    def picture(self, asked: Mapping[str, Any]) -> bytes:
        """Return the next picture, after the commands in ``asked``: the length of a JSON text, the text, grey values.

        Raises BadInput if something that is asked for is not allowed.
        """
        with self._turn:
            running = self._method is not None and self._method.is_alive()
            pace = float(asked.get("pace", self._pace))
            if not 0.001 <= pace <= 1:
                raise BadInput(f"the pace is {pace:g}", allowed="0.001 to 1, a fraction of real time")
            self._pace = pace
            self._set_light(asked)
            if not running:
                if (region := asked.get("region", self.camera.region)) != self.camera.region:
                    self.camera.region = region
                if "focus" in asked:
                    self.camera.focus = asked["focus"]
                self._run(int(asked.get("window", WINDOW)))
            counts, frames = self.camera.last_counts()
            names = [str(name) for name in asked.get("measures", MEASURES)][: len(MEASURES)]
            scores = [self._score(name) for name in names]
            head = json.dumps(self._describe(counts, frames, running=running) | {"scores": scores}).encode()
            grey = self._grey_values(frames)[counts]
            return len(head).to_bytes(4, "little") + head + grey.tobytes()

    def start_method(self, name: str) -> None:
        """Let a method turn the lens; raise BadInput if it is not on the page's list or if another one is running."""
        if name not in DEFAULT_CLOSED_LOOP_METHODS:
            raise unknown("method", name, allowed=DEFAULT_CLOSED_LOOP_METHODS)
        with self._turn:
            if self._method is not None and self._method.is_alive():
                raise BadInput("a method is running already", hint="wait until it has ended, or stop it")
            self._run(WINDOW)  # the page has a picture until the method looks
            self._said = f"{name} is looking for the focus"
            self._stop.clear()
            self._method = threading.Thread(target=self._run_method, args=(name,), daemon=True)
            self._method.start()

    def stop_method(self) -> None:
        """Stop the method that is running, if any, and wait until it has ended."""
        self._stop.set()
        if self._method is not None:
            self._method.join()

    def _run_method(self, name: str) -> None:
        begun = time.perf_counter()

        def keep_pace(frames: int) -> None:
            nonlocal begun
            begun = max(begun + frames / self.camera.readout_hz / self._pace, time.perf_counter() - LONGEST_STEP_S)
            if self._stop.wait(max(begun - time.perf_counter(), 0)):
                raise Stopped

        try:
            run = self.camera.run(name, budget_s=METHOD_S, watch=keep_pace)
        except Stopped:
            self._said = f"{name} was stopped"
        except SafGenError as error:
            self._said = f"{name}: {error}"
        else:
            answer = f"no answer: {run.note}" if run.position is None else f"lens at {run.position:.4f}"
            off = "" if run.error_dof is None else f", {run.error_dof:+.2f} depths of focus from the true focus"
            self._said = f"{name}: {answer}{off}, after {run.seconds * 1e3:.0f} ms and {run.windows} windows"

    def _set_light(self, asked: Mapping[str, Any]) -> None:
        for lamp, gain in dict(asked.get("lamps", {})).items():
            self.camera.dim(lamp, float(gain))
        if (light := asked.get("light", self._light)) != self._light:
            if light not in SCHEDULES:
                raise unknown("light", str(light), allowed=SCHEDULES)
            self.camera.play(SCHEDULES[light], seconds=SCHEDULE_S)
            self._light = light

    def _run(self, window: int) -> None:
        """Let the camera run for the time that has passed on the wall, and read its last ``window`` readouts."""
        if not 1 <= window <= MAX_READ_FRAMES // 10:
            raise BadInput(f"a window of {window} readouts", allowed=f"1 to {MAX_READ_FRAMES // 10:,}")
        per_s = self.camera.readout_hz * self._pace
        early = (window - self._due) / per_s - (time.perf_counter() - self._before)
        time.sleep(min(max(early, 0.0), LONGEST_STEP_S))
        begun = time.perf_counter()
        self._due += min(begun - self._before, LONGEST_STEP_S) * per_s
        self._before = begun
        frames = max(min(int(self._due), int(self._readouts_per_s * COMPUTING_S)), window)
        self._due = min(max(self._due - frames, -float(window)), window)
        if frames > window:
            self.camera.wait(frames - window)
        self.camera.read(window)
        ended = time.perf_counter()
        self._readouts_per_s += 0.1 * (frames / (ended - begun) - self._readouts_per_s)
        if ended - self._clock[0] > 1:
            self._factor = (self.camera.seconds - self._clock[1]) / (ended - self._clock[0])
            self._clock = (ended, self.camera.seconds)

    def _score(self, name: str) -> float | None:
        if name not in measure_names():  # a request must not load a file's code
            raise unknown("focus measure", name, allowed=measure_names())
        score = self.camera.score(name) if self._method is None or not self._method.is_alive() else None
        return score if score is not None and np.isfinite(score) else None

    def _describe(self, counts: np.ndarray, frames: int, *, running: bool) -> dict[str, Any]:
        camera, truth = self.camera, self.camera.true_focus
        return {
            "rows": counts.shape[0],
            "columns": counts.shape[1],
            "frames": frames,
            "seconds": camera.seconds,
            "focus": camera.focus,
            "lens": camera.lens,
            "truth": truth if np.isfinite(truth) else None,
            "possible": self._readouts_per_s,
            "possible_factor": self._readouts_per_s / camera.readout_hz,
            "factor": self._factor,
            "running": running,
            "said": self._said,
        }

    def _grey_values(self, frames: int) -> np.ndarray:
        """Return the grey value of each number of spikes in a window; lamps do not move the white level."""
        counts = np.arange(frames + 1)
        return np.rint(255 * display_gamma(counts, frames * self._white)).astype(np.uint8)


def _mean_rate(charge: np.ndarray, sensor: Any) -> np.ndarray:
    """Return the ones per readout of a pixel at a constant mean charge per readout, which is counted in photons."""
    if isinstance(sensor, SpadSensor):
        return detection_rate(charge * sensor.gate, sensor)
    return firing_rate(charge, sensor)


class LiveServer(ThreadingHTTPServer):
    """The server of a page, at a port of the loopback address.

    Parameters
    ----------
    room : LiveRoom
        What the page shows.
    port : int
        Port; 0 chooses a free one.

    Raises
    ------
    BadInput
        If the port is taken or may not be used.
    """

    daemon_threads = True
    allow_reuse_address = True

    def __init__(self, room: LiveRoom, port: int) -> None:
        self.room, self.token = room, secrets.token_urlsafe(16)
        try:
            super().__init__(("127.0.0.1", port), _Handler)
        except OSError as error:
            raise BadInput(
                f"port {port} cannot be used: {error.strerror or error}",
                allowed="a free port from 1024 to 65535",
                hint="leave --port out, which chooses one",
            ) from None

    @property
    def address(self) -> str:
        """Address of the page, with the word that only its reader knows."""
        return f"http://127.0.0.1:{self.server_port}/{self.token}/"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing: a browser that closes a connection is no fault."""


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True  # a small answer is sent at once
    timeout: ClassVar[float] = 20.0  # seconds for a request to arrive whole
    server: LiveServer

    def do_GET(self) -> None:
        if self._allowed() == "":
            nonce = secrets.token_urlsafe(16)
            policy = f"default-src 'none'; script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; connect-src 'self'"
            headers = {"Content-Security-Policy": f"{policy}; base-uri 'none'; form-action 'none'"}
            page = make_page(self.server.room.camera, nonce).encode()
            self._send(200, page, kind="text/html; charset=utf-8", headers=headers)

    def do_POST(self) -> None:
        path, room = self._allowed(), self.server.room
        if path is None:
            return
        try:
            asked = self._read_body()
            if path == "picture":
                self._send(200, room.picture(asked), kind="application/octet-stream")
            elif path == "method":
                room.start_method(str(asked.get("name")))
                self._send(200, b"{}", kind="application/json")
            elif path == "stop":
                room.stop_method()
                self._send(200, b"{}", kind="application/json")
            else:
                self._refuse(404, NOTHING_HERE)
        except (SafGenError, ValueError, TypeError, AttributeError) as error:
            why = str(error) if isinstance(error, SafGenError) else f"The request is not understood: {error}."
            self._send(400, json.dumps({"error": why}).encode(), kind="application/json")

    def _allowed(self) -> str | None:
        """Return what is asked for below the address of the page; None, after an answer, if nobody may ask for it."""
        host, origin = self.headers.get("Host", ""), self.headers.get("Origin")
        if urlsplit(f"//{host}").hostname not in HOSTS or origin not in (None, f"http://{host}"):
            self._refuse(403, f"This camera answers only pages of {' and '.join(HOSTS)}: open the address it printed.")
            return None
        token, slash, path = self.path.removeprefix("/").partition("/")
        if not (slash and hmac.compare_digest(token.encode(), self.server.token.encode())):
            self._refuse(404, NOTHING_HERE)
            return None
        if self.command == "GET" and path:
            self._refuse(404, NOTHING_HERE)
        return path

    def _read_body(self) -> dict[str, Any]:
        length = int(self.headers.get("Content-Length", 0))
        if not 0 <= length <= MAX_BODY:
            self.close_connection = True
            raise ValueError("the request is too long")
        asked = json.loads(self.rfile.read(length) or b"{}")
        if not isinstance(asked, dict):
            raise ValueError("the request is not an object")
        return asked

    def _refuse(self, code: int, why: str) -> None:
        self.close_connection = True  # what it sends is not read
        self._send(code, f"{why}\n".encode(), kind="text/plain; charset=utf-8")

    def _send(
        self, code: int, body: bytes = b"", *, kind: str = "text/plain", headers: Mapping[str, str] | None = None
    ) -> None:
        self.send_response(code)
        given = {"Content-Type": kind, "Content-Length": str(len(body)), "Cache-Control": "no-store"}
        for name, value in {**given, "X-Content-Type-Options": "nosniff", **(headers or {})}.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing: the terminal belongs to whoever started the camera."""


def make_page(camera: LiveCamera, nonce: str) -> str:
    """Return the page of a camera, whose script and style the browser runs by their ``nonce``."""
    here, plots = files("saf_gen.addons.live"), files("saf_gen") / "leaderboard" / "report" / "assets" / "uplot"
    methods = [name for name in DEFAULT_CLOSED_LOOP_METHODS if not camera.misfit_of_method(parse_method(name))]
    scene = camera.capture.plane_source.time_stack.specs[0].scene
    setup = {
        "lamps": camera.gains,
        "regions": REGIONS,
        "region": camera.region,
        "readout_hz": camera.readout_hz,
        "measures": [name for name in measure_names() if not camera.misfit_of_measure(name)],
        "drawn": MEASURES,
        "lights": list(SCHEDULES),
        "methods": {
            name: "; ".join(f"{n}: {words}" for n, words in spell_out_names([name]).items()) for name in methods
        },
        "focus": camera.focus,
    }
    parts = {
        "{{nonce}}": nonce,
        "{{scene}}": escape(scene),
        "{{plot_style}}": (plots / "uPlot.min.css").read_text(encoding="utf-8"),
        "{{plot_script}}": (plots / "uPlot.iife.min.js").read_text(encoding="utf-8"),
        "{{setup}}": json.dumps(setup).replace("<", "\\u003c"),
        "{{script}}": (here / "page.js").read_text(encoding="utf-8"),
    }
    page = (here / "page.html").read_text(encoding="utf-8")
    for name, text in parts.items():
        page = page.replace(name, text)
    return page
