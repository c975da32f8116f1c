"""A spike camera that runs for as long as somebody looks: the camera of the closed loop without an end.

Every readout is the encoder's, with the lamps and the lens of that moment. The camera delivers packets of 8 readouts,
so a command takes effect at the next packet.
"""

import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from saf_gen.addons.live.source import SENSOR, open_capture
from saf_gen.benchmark.admission import admit_method
from saf_gen.benchmark.judgement import judge
from saf_gen.benchmark.method_spec import Method
from saf_gen.benchmark.suitability import measure_misfit, method_misfit
from saf_gen.benchmark.tracks.closed_loop_run import run_closed_loop
from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
from saf_gen.benchmark.view.clock import PACKET_FRAMES
from saf_gen.benchmark.view.held import SpikePlanes
from saf_gen.benchmark.view.operations import OPERATIONS_PER_S
from saf_gen.benchmark.view.running_camera import REST_TOLERANCE
from saf_gen.camera.camera import LensCourse, Span
from saf_gen.core import bits
from saf_gen.core.region import Region, bounding_box, region_shape
from saf_gen.core.seeds import derive_seed
from saf_gen.errors import BadInput, unknown
from saf_gen.optics.actuators import ActuatedLens, get_actuator
from saf_gen.parts import commands
from saf_gen.plugins.lights import PRODUCT, build_light, gains_at_readouts
from saf_gen.plugins.measures import get_measure
from saf_gen.stack.capture import Capture
from saf_gen.stack.charge_source import ChargeSource
from saf_gen.stack.light import SceneLight
from saf_gen.stream.interval_texture import window_time_texture
from saf_gen.stream.measure_input import Form, WindowSource, measure_input, wanted_form

CHUNK_FRAMES = 512
"""Largest number of readouts that are encoded at once."""
MAX_READ_FRAMES = 20_000
MAX_GAIN = 100.0
REGIONS = ("target", "frame")
HOLDER = "this camera counts"


@dataclass(frozen=True)
class LiveRun:
    """What a method did with the lens.

    Attributes
    ----------
    method : str
        Name of the method.
    position : float or None
        Where the lens ended, as a fraction of the travel; None if the method gave no answer.
    truth : float or None
        The true focus at that time; None if it is unknown.
    error_dof : float or None
        Error in depths of focus.
    seconds : float
        Time of the camera until the method was done.
    windows : int
        Number of windows that it looked at.
    note : str
        Why it failed or abstained, or ''.
    """

    method: str
    position: float | None
    truth: float | None
    error_dof: float | None
    seconds: float
    windows: int
    note: str


class LiveCamera:
    """A spike camera in front of a scene, with a lens to turn and lamps to dim.

    Time passes only in :meth:`read`, :meth:`score`, :meth:`wait`, :meth:`settle` and :meth:`run`, by as many readouts
    as they say. The same calls with the same seed give the same counts on any machine. A scene that moves begins again
    when its recording is over. Threads may share a camera; their calls then follow one another.

    Parameters
    ----------
    source : str, Path or Capture
        A dataset folder with focal stacks, one of its streams, or the name of a scene, which is rendered first and
        kept; see :func:`saf_gen.addons.live.source.open_capture`.
    region : str, default 'target'
        Pixels that are read out: ``target``, the box around the target, or ``frame``.
    actuator : str or Path, default 'voice_coil'
        Name or file of the drive of the lens.
    start : float, default 0.5
        First position of the lens, as a fraction of the travel.
    seed : int, optional
        Seed of noise and lens; by default that of the recording.
    sensor : str, default 'vidar_400x250'
        Sensor in front of a scene; a recording has its own.
    threads : int, optional
        Number of threads that encode; by default one per core.

    Attributes
    ----------
    readout_hz : float
        Readouts per second.
    lamps : tuple of str
        Names of the lamps.
    readouts : int
        Readouts that have been encoded; those of a packet count at once.

    Raises
    ------
    BadInput
        If the source cannot be opened, or a name or the start is not valid.

    Examples
    --------
    >>> camera = LiveCamera("datasets/quickstart")  # doctest: +SKIP
    >>> camera.focus = 0.4  # doctest: +SKIP
    >>> camera.settle()  # doctest: +SKIP
    >>> camera.score("sd", frames=200)  # doctest: +SKIP
    """

    def __init__(
        self,
        source: str | Path | Capture,
        *,
        region: str = "target",
        actuator: str | Path = "voice_coil",
        start: float = 0.5,
        seed: int | None = None,
        sensor: str = SENSOR,
        threads: int | None = None,
    ) -> None:
        self._actuator = get_actuator(actuator)
        capture = source if isinstance(source, Capture) else open_capture(source, sensor=sensor)
        if capture.camera.form != "bits":
            raise BadInput(f"{capture.sensor.name} reads out {capture.camera.form}", allowed="a camera of bits")
        self.capture = capture if seed is None else replace(capture, seed=seed)
        self.readout_hz, self._threads = float(capture.sensor.readout_hz), threads
        lamps, groups = capture.colour, capture.plane_source.time_stack.specs[0].groups
        self.lamps = groups if lamps is None else tuple(lamp.name for lamp in lamps.lamps)
        self._gains = np.ones(len(self.lamps))
        self._curve = np.ones(1)
        self._sources: dict[str, ChargeSource] = {}
        self._lock = threading.RLock()
        self.readouts = self._lens_starts = self._starts = self._left = 0
        self._last = np.zeros((0, 0, 0), np.uint8)  # the packet from which the last _left readouts have not been read
        self._lens = self._make_lens(start)
        self._where = float(start)
        self._window: tuple[WindowSource, int, int] | None = None
        self.region = region

    @property
    def seconds(self) -> float:
        """Time of the camera: of the readouts that have been read or waited for."""
        return (self.readouts - self._left) / self.readout_hz

    @property
    def region(self) -> str:
        """``target`` or ``frame``; if it is set to the other, all pixels begin anew, with new noise."""
        return self._region

    @region.setter
    def region(self, name: str) -> None:
        if name not in REGIONS:
            raise unknown("region", name, allowed=REGIONS)
        with self._lock:
            capture, target = self.capture, self.capture.truth.target
            box: Region = slice(0, capture.sensor.rows), slice(0, capture.sensor.columns)
            if name == "target" and target is not None and target.any():
                box = bounding_box(target)
            rows = capture.rows_for(box)
            if name not in self._sources:
                self._sources[name] = capture.open_charge_source(rows)
            if self._starts:
                capture = replace(capture, seed=derive_seed(capture.seed, "live", self._starts))
            self._sensor_array = capture.start_camera(rows, threads=self._threads)
            self._inside = slice(box[0].start - rows.start, box[0].stop - rows.start), box[1]
            self._region, self._box, self._charge = name, box, self._sources[name]
            self._starts, self._window = self._starts + 1, None
            self._last, self._left = np.zeros((*self.shape, 1), np.uint8), 0

    @property
    def box(self) -> Region:
        """Rows and columns of the sensor that are read out."""
        return self._box

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of what :meth:`read` returns."""
        return region_shape(self._box)

    @property
    def focus(self) -> float:
        """Position to which the lens was sent, as a fraction of the travel; set it to send the lens elsewhere."""
        return self._lens.target

    @focus.setter
    def focus(self, position: float) -> None:
        if not 0 <= position <= 1:
            raise BadInput(f"focus is {position!r}", allowed="0 to 1, a fraction of the travel")
        with self._lock:
            self._lens.command(float(position))

    @property
    def lens(self) -> float:
        """Position of the lens in the last readout, as a fraction of the travel."""
        return self._where

    @property
    def is_settled(self) -> bool:
        """Whether the lens rests."""
        return self._lens.is_settled(REST_TOLERANCE)

    @property
    def true_focus(self) -> float:
        """Position of the lens at which the target is in focus now, as a fraction of the travel; NaN if unknown."""
        truth = self.capture.truth
        return truth.position if truth.track is None or not self._moves else float(truth.track[self._scene_frame])

    @property
    def gains(self) -> dict[str, float]:
        """Gain of each lamp by its name; 1 is the light of the recording."""
        return dict(zip(self.lamps, self._gains.tolist(), strict=True))

    def dim(self, lamp: str, gain: float) -> None:
        """Set the gain of a lamp, 0 to 100. Raises BadInput if the lamp is unknown or the gain is not allowed."""
        if lamp not in self.lamps:
            raise unknown("lamp", lamp, allowed=self.lamps)
        if not 0 <= gain <= MAX_GAIN:
            raise BadInput(f"the gain of lamp {lamp!r} is {gain!r}", allowed=f"0 to {MAX_GAIN:g}")
        gains = self._gains.copy()
        gains[self.lamps.index(lamp)] = gain
        self._gains = gains

    def play(self, schedule: Mapping[str, Any] | None, *, seconds: float = 1.0) -> None:
        """Let all lamps follow a light schedule, on top of their gains, from the next packet on.

        Parameters
        ----------
        schedule : mapping or None
            A schedule as a recipe states it for all lamps, such as ``{"kind": "flicker", "depth": 0.3}`` or
            ``{"product": [...]}``; None for constant light.
        seconds : float, default 1.0
            Duration of the schedule in the time of the camera, above 0 and at most 60; it is repeated.

        Raises
        ------
        BadInput
            If the schedule is not valid.
        """
        if not 0 < seconds <= 60:
            raise BadInput(f"a schedule of {seconds!r} s", allowed="above 0, at most 60")
        component = dict(schedule or {})
        if PRODUCT not in component:
            component.setdefault("kind", "constant")
        frames = max(round(seconds * self.readout_hz), 1) if schedule else 1
        light = build_light(component)
        curve = gains_at_readouts(light, frames, readout_hz=self.readout_hz).astype(np.float64)
        self._curve = np.roll(curve, self.readouts % frames)

    def read(self, frames: int) -> np.ndarray:
        """Let a number of readouts pass, and return how often each pixel fired in them: uint32 (h, w).

        Raises BadInput unless ``frames`` is a whole number from 1 to 20,000.
        """
        if isinstance(frames, bool) or not isinstance(frames, int) or not 1 <= frames <= MAX_READ_FRAMES:
            raise BadInput(f"{frames!r} frames were asked for", allowed=f"a whole number, 1 to {MAX_READ_FRAMES:,}")
        with self._lock:
            held, first = (1, PACKET_FRAMES - self._left) if self._left else (0, 0)
            trains = np.empty((*self.shape, held - (self._left - frames) // PACKET_FRAMES), np.uint8)
            trains[:, :, :held] = self._last[:, :, :held]
            for spikes in self._pass(frames):
                trains[:, :, held : held + spikes.shape[2]] = spikes
                held += spikes.shape[2]
            window = _SpikeTrains(trains)
            self._window = window, first, first + frames
        return window.window(first, first + frames)

    def wait(self, frames: int) -> None:
        """Let a number of readouts pass that nobody looks at."""
        with self._lock:
            for _ in self._pass(frames):
                pass

    def settle(self, within: float = REST_TOLERANCE, *, seconds: float = 5.0) -> None:
        """Let time pass until the lens rests to within a fraction of the travel, but at most ``seconds``."""
        with self._lock:
            last = self.seconds + seconds
            while not self._lens.is_settled(within) and self.seconds < last:
                self.wait(5 * PACKET_FRAMES)

    def score(self, measure: str, frames: int | None = None) -> float:
        """Return the score of a focus measure, of the next ``frames`` readouts or, without them, of the last window.

        Raises BadInput if the measure or ``frames`` is not valid, if the measure does not suit the camera, or if
        nothing has been read yet.
        """
        if misfit := self.misfit_of_measure(measure):
            raise misfit
        scorer = get_measure(measure)
        with self._lock:
            if frames is not None:
                self.read(frames)
            return float(scorer(self.last_window(wanted_form(scorer))))

    def misfit_of_measure(self, measure: str) -> BadInput | None:
        """Return the error that says why a measure does not suit the camera, or None if it does."""
        return measure_misfit(measure, self.capture.kind, form="bits", holder=HOLDER)

    def misfit_of_method(self, method: Method) -> BadInput | None:
        """Return the error that says why a method does not suit the camera, or None if it does."""
        return method_misfit(method, self.capture.kind, form="bits", holder=HOLDER)

    def last_window(self, form: Form = "counts") -> np.ndarray:
        """Return the readouts that were read last, as a measure is called with them; BadInput if there are none."""
        if (held := self._window) is None:
            raise BadInput("nothing has been read yet", hint="read frames first")
        window, first, stop = held
        return measure_input(window, form, first=first, stop=stop)

    def last_counts(self) -> tuple[np.ndarray, int]:
        """Return how often each pixel fired in the readouts that were read last, uint32 (h, w), and their number."""
        if (held := self._window) is None:
            raise BadInput("nothing has been read yet", hint="read frames first")
        return held[0].window(held[1], held[2]), held[2] - held[1]

    def nominal_charge(self, position: float) -> np.ndarray:
        """Return the photo-electrons per readout with all gains at 1 and the lens at a position, float32 (h, w)."""
        charge = self._charge.nominal_image(self._scene_frame, position)
        return charge[self._inside]

    def run(self, method: str, *, budget_s: float = 0.5, watch: Callable[[int], None] = lambda frames: None) -> LiveRun:
        """Let a method of the closed loop find the focus, from where the lens is now.

        The lens rests when the method begins. Lamps may change while it runs.

        Parameters
        ----------
        method : str
            Name of a method, such as ``sd+golden_section``.
        budget_s : float, default 0.5
            Time of the camera until the lens is judged, in seconds.
        watch : callable, optional
            Called with the number of readouts each time that the camera has recorded some.

        Raises
        ------
        BadInput
            If there is no such method, if it does not suit the camera, or if the drive is too slow for it.
        """
        found = admit_method(method)
        if misfit := self.misfit_of_method(found):
            raise misfit
        protocol = ClosedLoopProtocol(self._actuator, budget_s, operations_per_s=OPERATIONS_PER_S)
        with self._lock:
            frames, seed = round(budget_s * self.readout_hz), derive_seed(self.capture.seed, "live run", self.readouts)
            capture = replace(self.capture, seed=seed, frames=frames, gain=np.ones((frames, 1), np.float32), slices="")
            if not commands(found.search):
                protocol.check_sweep(capture)
            truth = self.capture.truth
            if truth.track is not None:  # that of a mix of lamps over the recording says nothing of the lamps here
                track = np.resize(np.roll(truth.track, -self._scene_frame), frames)
                truth = replace(truth, track=track if self._moves else None)
            seen = _RunFrames(self, capture, watch=watch)
            try:
                run = run_closed_loop(seen, found, protocol=protocol, start=self._where)
                seen.encode_until(len(run.path), run.path)  # also the last readouts, which the method did not look at
            finally:
                self._left, self._lens = 0, self._make_lens(self._where)
        judgement = judge(run, truth, end_s=lambda frames: frames / self.readout_hz)
        return LiveRun(
            method=found.name,
            position=judgement.position,
            truth=judgement.truth,
            error_dof=judgement.error_dof,
            seconds=run.frames_seen / self.readout_hz,
            windows=run.windows,
            note=judgement.note,
        )

    def _make_lens(self, position: float) -> ActuatedLens:
        """Return a lens at rest, with noise of its own."""
        seed = derive_seed(self.capture.seed, "live lens", self._lens_starts)
        self._lens_starts += 1
        return ActuatedLens(self._actuator, start=position, readout_hz=self.readout_hz, seed=seed)

    @property
    def _moves(self) -> bool:
        return self.capture.plane_source.time_stack.is_moving

    @property
    def _scene_frame(self) -> int:
        """Frame of the recording whose scene is in front of the camera."""
        return self.readouts % self._scene_frames

    @property
    def _scene_frames(self) -> int:
        return self.capture.frames // PACKET_FRAMES * PACKET_FRAMES

    def _pass(self, frames: int) -> Iterator[np.ndarray]:
        """Let a number of readouts pass, and yield the packets that this needs beyond those that are there."""
        need = frames - self._left
        while need > 0:
            count = min(-(-need // PACKET_FRAMES) * PACKET_FRAMES, CHUNK_FRAMES)
            positions = self._lens.run(count)
            self._lens.forget_readings()
            spikes = self._record(positions)
            self._last = spikes[:, :, -1:].copy()
            need -= count
            yield spikes
        self._left = -need

    def _record(self, positions: np.ndarray) -> np.ndarray:
        """Encode the next readouts with the lens at these positions; return the spikes of the box, (h, w, bytes)."""
        frames, begin = len(positions), self.readouts
        at = np.arange(begin, begin + frames) % len(self._curve)
        gains = self._curve[at][:, None] * self._gains
        parts = [self._encode(run, done, positions=positions, gains=gains) for run, done in self._split(begin, frames)]
        self.readouts += frames
        self._where = float(positions[-1])
        return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=2)

    def _split(self, begin: int, frames: int) -> Iterator[tuple[Span, int]]:
        """Yield the runs of the recording's scene that the next frames see, and how many frames are before each."""
        stack, done = self.capture.plane_source.time_stack, 0
        if not stack.is_moving:
            yield Span(0, frames, 0), 0
            return
        while done < frames:
            first = (begin + done) % self._scene_frames
            for run in stack.split_at_slices(first, min(first + frames - done, self._scene_frames)):
                yield run, done
                done += run.end - run.begin

    def _encode(self, run: Span, done: int, *, positions: np.ndarray, gains: np.ndarray) -> np.ndarray:
        stop = done + run.end - run.begin
        position = np.concatenate([np.zeros(run.begin), positions[done:stop]])
        gain = np.concatenate([np.ones((run.begin, gains.shape[1])), gains[done:stop]])
        light, lens = SceneLight(self._charge, gain), LensCourse(position, self.readout_hz)
        spikes = np.concatenate(list(self._sensor_array.expose(light, run, lens=lens)), axis=2)
        return spikes[self._inside]


class _SpikeTrains:
    """Spikes of the last readouts as the encoder returns them, uint8 (h, w, bytes)."""

    def __init__(self, trains: np.ndarray) -> None:
        self._trains = trains

    def window(self, first: int, stop: int) -> np.ndarray:
        """Return the counts of frames ``first <= t < stop``, uint32 (h, w)."""
        counts = np.zeros((1, *self._trains.shape[:2]), np.uint32)
        bits.sum_trains(self._trains, counts, firsts=np.array([first]), stops=np.array([stop]))
        return counts[0]

    def intervals(self, first: int, stop: int) -> np.ndarray:
        """Return the interval texture of a window, float64 (h, w); see window_texture."""
        image, _ = window_time_texture(lambda a, b: self._trains[:, :, a:b], self.window, first=first, stop=stop)
        return image


class _RunFrames(SpikePlanes):
    """The frames that a method sees, recorded by the live camera; frames count from the beginning of the run."""

    def __init__(self, camera: LiveCamera, capture: Capture, *, watch: Callable[[int], None]) -> None:
        super().__init__(np.zeros((-(-capture.frames // PACKET_FRAMES), *camera.shape), np.uint8))
        self.capture, self.frames, self._camera, self._watch = capture, 0, camera, watch

    def encode_until(self, stop: int, position: np.ndarray) -> None:
        """Encode all readouts before ``stop``, a multiple of 8, with the lens at these positions."""
        while self.frames < stop:
            first, last = self.frames, min(self.frames + CHUNK_FRAMES, stop)
            spikes = self._camera._record(position[first:last])
            self._planes[first // PACKET_FRAMES : last // PACKET_FRAMES] = spikes.transpose(2, 0, 1)
            self.frames = last
            self._camera._window = self, first, last
            self._watch(last - first)
