"""The faults: what each breaks, how it is planted, and the tests that must fail under it."""

from dataclasses import dataclass

from planting import Change

EACH_LAW = "studies/test_laws.py::test_a_law_holds_at_its_small_size"
RENDERED = (
    "render/",
    "optics/test_microscope",
    "addons/lens_files/test_rendered",
    "benchmark/test_closed_loop_events",
    EACH_LAW,
)
"""Tests that render, which takes long and needs LLVM."""
COMPILED = ("camera.encoder_kernel", "camera.events.kernel", "camera.photons.kernel")
"""Modules that take long to compile."""


@dataclass(frozen=True)
class Fault:
    """A mistake that someone could make.

    Attributes
    ----------
    breaks : str
        What it makes wrong, in a sentence.
    changes : tuple of Change
        Changes to the source of the package.
    tests : tuple of str
        Tests below tests/; under the fault each of them fails by an assertion, in at least one case.
    """

    breaks: str
    changes: tuple[Change, ...]
    tests: tuple[str, ...]

    @property
    def cheap_tests(self) -> tuple[str, ...]:
        """The tests that do not render; empty if a kernel must be compiled with the fault."""
        if any(change.module in COMPILED for change in self.changes):
            return ()
        return tuple(test for test in self.tests if not test.startswith(RENDERED))


FAULTS = {
    "blur by f for v": Fault(
        "The blur on the sensor is computed with the focal length instead of the image distance.",
        (
            Change(
                "optics._drive",
                "return 2 * self.aperture_radius_m * self.image_distance(position) * np.abs(",
                "power = 1 / self.image_distance(position) + 1 / self.object_distance(position)\n"
                "        return 2 * self.aperture_radius_m / power * np.abs(",
            ),
        ),
        (
            "optics/test_focus_drives.py::test_blur_is_one_pixel_at_the_ends_of_the_depth_of_focus",
            "optics/test_microscope.py::test_an_edge_is_blurred_placed_and_in_focus_by_the_closed_forms",
        ),
    ),
    "near for far": Fault(
        "The blur of a pixel is positive in front of the plane in focus, as if the surface lay behind it.",
        (
            Change(
                "stream.defocus_blur",
                "object_distance(position)) - vergence)",
                "object_distance(position)) - vergence) * -1",
            ),
        ),
        (
            "stream/test_defocus_blur.py::test_blur_is_the_law_of_the_thin_lens_in_every_frame",
            "stream/test_defocus_blur.py::test_what_is_behind_the_plane_in_focus_is_positive",
        ),
    ),
    "blur over the image in focus": Fault(
        "The blur of a pixel is A·|v - v'|/v, as for small defocus, and not over the image distance v' of the surface.",
        (
            Change(
                "stream.defocus_blur",
                "(1 / float(lens.object_distance(position)) - vergence)",
                "(d := 1 / float(lens.object_distance(position)) - vergence)"
                " / (1 + d * float(lens.image_distance(position)))",
            ),
        ),
        (
            "stream/test_defocus_blur.py::test_blur_is_the_law_of_the_thin_lens_in_every_frame",
            "stream/test_defocus_blur.py::test_a_liquid_lens_and_a_stage_obey_it_too",
        ),
    ),
    "light of a point": Fault(
        "The all-in-focus picture has the light that the aperture of a point collects, not the lens of the recording.",
        (Change("stack.all_in_focus", "replace(point, drive=spec.drive) for", "point for"),),
        (
            "generate/test_sharp_recipe.py::test_the_charge_is_that_of_the_aperture_of_the_recording[at rest]",
            "generate/test_sharp_recipe.py::test_the_charge_is_that_of_the_aperture_of_the_recording[moving]",
            "render/test_sharp_truth.py::test_in_focus_it_is_the_recorded_picture_of_each_light[still]",
        ),
    ),
    "sharp beside the lens": Fault(
        "The all-in-focus pictures of a moving scene have the scale of the end of the sweep, not of where the lens is.",
        (Change("stack.all_in_focus", "slice_windows(position, ", "slice_windows(position[-1:], "),),
        (
            "generate/test_sharp_recipe.py::test_the_lens_is_the_same_with_the_aperture_of_a_point",
            "generate/test_sharp_recipe.py::test_the_charge_is_that_of_the_aperture_of_the_recording[moving]",
        ),
    ),
    "no cos⁴": Fault(
        "The corners of the sensor get as much light as its middle.",
        (Change("camera.exposure", "/ v2 * cos2 * cos2", "/ v2 * cos2**0"),),
        (
            "camera/test_exposure.py::test_irradiance_falls_with_the_fourth_power_of_the_cosine",
            f"{EACH_LAW}[radiometry_field_angle]",
        ),
    ),
    "no bellows": Fault(
        "Light on the sensor does not fall with the square of the image distance: all positions use that of the first.",
        (Change("camera.exposure", "distance[None],", "image_distance[:1],"),),
        (
            "camera/test_exposure.py::test_a_uniform_scene_gives_a_rate_of_charge_over_threshold_with_cos4_and_bellows",
            f"{EACH_LAW}[radiometry_bellows]",
        ),
    ),
    "near and far swapped": Fault(
        "Position 0 focuses where position 1 should, and vice versa.",
        (
            Change("optics.image_distance_drive", "return first, last\n", "return last, first\n"),
            Change("optics.focal_length_drive", "first, last = (", "last, first = ("),
        ),
        (
            "optics/test_focus_drives.py::test_the_ends_of_the_travel_focus_where_the_card_says",
            f"{EACH_LAW}[truth_depths]",
        ),
    ),
    "stage reversed": Fault(
        "Raising the stage moves the specimen away from the lens.",
        (
            Change("optics.microscope_stage", "return first + (last - first) *", "return -first - (last - first) *"),
            Change(
                "optics.microscope_stage",
                "return (np.asarray(shift, dtype=np.float64) - first)",
                "return (-np.asarray(shift, dtype=np.float64) - first)",
            ),
        ),
        (
            "optics/test_focus_drives.py::test_the_ends_of_the_travel_focus_where_the_card_says",
            f"{EACH_LAW}[optics_breathing]",
        ),
    ),
    "shot noise halved": Fault(
        "The charge of an interval has half the variance of a Poisson process.",
        (Change("camera.encoder", "variance += level\n", "variance += level / 2\n"),),
        (
            "camera/test_encoder.py::test_shot_noise_makes_the_variance_of_an_interval_the_threshold",
            f"{EACH_LAW}[noise_photon_transfer]",
        ),
    ),
    "threshold noise per readout": Fault(
        "A threshold is drawn at each readout instead of at each spike.",
        (Change("camera.encoder_kernel", "fresh if fired else threshold,", "fresh,"),),
        ("camera/test_encoder.py::test_threshold_noise_alone_has_its_own_variance", f"{EACH_LAW}[noise_intervals]"),
    ),
    "response on dark": Fault(
        "The photo-response of a pixel also multiplies its dark charge, which is not due to light.",
        (Change("camera.encoder", "[pattern.dark.ravel(),", "[(pattern.dark * pattern.response).ravel(),"),),
        (
            "camera/test_encoder.py::test_the_bits_are_those_of_the_scalar_reference[pattern]",
            "camera/test_independent_noise.py::test_dark_charge_does_not_depend_on_the_response_to_light",
        ),
    ),
    "quarter pixel": Fault(
        "Every picture is shifted by a quarter of a pixel along the rows.",
        (
            Change(
                "render.camera_rays",
                "first_x * pixels_per_m + opaque(grid.columns / 2),",
                "first_x * pixels_per_m + opaque(grid.columns / 2 + 0.25),",
            ),
        ),
        (
            "render/test_camera_rays.py::test_a_ray_meets_its_own_pixel_at_the_middle_of_the_travel",
            f"{EACH_LAW}[optics_breathing]",
        ),
    ),
    "firefly clip": Fault(
        "Light paths are clipped at half the radiance of the brightest path of a trial, not at 64 times that radiance.",
        (
            Change(
                "render.one_pass", "max_radiance = FIREFLY_FACTOR * _brightest(", "max_radiance = 0.5 * _brightest("
            ),
            Change("render.one_pass", "max_radiance = _brightest([first])", "max_radiance = 0.5 * _brightest([first])"),
            Change("render.filtered_pass", "one_pass.FIREFLY_FACTOR * _brightest(", "0.5 * _brightest("),
            Change("render.filtered_pass", "= _brightest([opening])", "= 0.5 * _brightest([opening])"),
        ),
        (
            "render/test_camera_rays.py::test_a_small_lamp_keeps_its_light_in_focus_and_out_of_it",
            f"{EACH_LAW}[optics_occlusion]",
        ),
    ),
    "angle doubled": Fault(
        "Waves bend a path at the aperture by twice the correct angle.",
        (Change("render.diffraction", "self.wavelength_m / (2 * math.pi))", "self.wavelength_m / math.pi)"),),
        ("render/test_diffraction.py::test_bent_paths_have_the_transfer_of_the_lens", f"{EACH_LAW}[optics_transfer]"),
    ),
    "dark twice": Fault(
        "Dark charge is collected twice.",
        (Change("camera.encoder", "[pattern.dark.ravel(),", "[2 * pattern.dark.ravel(),"),),
        (
            "camera/test_encoder.py::test_with_all_noise_on_the_mean_rate_is_light_plus_dark",
            "camera/test_exposure.py::test_the_scale_makes_the_encoder_fire_at_the_mean_rate[subtract-0.2]",
        ),
    ),
    "gains sampled": Fault(
        "The gain of a readout is that of its first instant, not the mean over the readout.",
        (
            Change(
                "plugins.lights._gains",
                "gains = np.diff(integral) * readout_hz",
                "after = registry.sample_function(\n"
                "        light, light.integral, seconds=edges[:-1] + 1e-3 / readout_hz, duration_s=edges[-1]\n"
                "    )\n"
                "    gains = (after - integral[:-1]) * readout_hz * 1e3",
            ),
        ),
        (
            "plugins/test_lights.py::test_gains_are_means_over_readouts_however_finely_time_is_cut",
            "plugins/test_lights.py::test_a_step_within_a_readout_counts_in_proportion",
        ),
    ),
    "jumps of one factor": Fault(
        "A product of light schedules is cut at the jumps and bends of its first factor alone.",
        (
            Change(
                "plugins.lights._product",
                "for time_s in {duration_s, end_s} for factor in self.factors]",
                "for time_s in {duration_s, end_s} for factor in self.factors[:1]]",
            ),
        ),
        (
            "plugins/test_light_products.py::test_jumps_within_a_readout_count_in_proportion",
            "plugins/test_light_products.py::test_factors_may_be_written_in_any_order",
        ),
    ),
    "means multiplied": Fault(
        "A product of light schedules multiplies means of its factors over a piece, not gains at each moment.",
        (
            Change(
                "plugins.lights._product",
                "gains *= _gains(factor, at, duration_s=duration_s)",
                "gains *= (0.5 * WEIGHTS) @ _gains(factor, at, duration_s=duration_s)",
            ),
        ),
        (
            "plugins/test_light_products.py::test_a_ramp_times_a_sine_has_its_closed_form",
            "plugins/test_light_products.py::test_two_sines_beat",
        ),
    ),
    "a group twice": Fault(
        "The first light group counts twice when the groups are added up.",
        (
            Change(
                "stack.charge_source",
                "self._static[False].sum(axis=0, keepdims=True)",
                "self._static[False].sum(axis=0, keepdims=True) + self._static[False][:1]",
            ),
            Change(
                "stack.charge_source",
                "charge.sum(axis=0, keepdims=True) if",
                "charge.sum(axis=0, keepdims=True) + charge[:1] if",
            ),
        ),
        (
            "stack/test_time_resolved.py::test_a_recording_of_a_moving_scene_fires_as_asked_and_keeps_its_track",
            f"{EACH_LAW}[light_additivity]",
        ),
    ),
    "residue halved": Fault(
        "After a spike, a pixel keeps only half of its charge above the threshold.",
        (Change("camera.encoder_kernel", "kept = excess if", "kept = np.float32(0.5) * excess if"),),
        (
            "camera/test_counting_law.py::test_the_covariance_of_adjacent_half_windows_obeys_the_law",
            f"{EACH_LAW}[noise_independence]",
        ),
    ),
    "events 3 % late": Fault(
        "The light must change by 3 % more than a threshold before an event camera reports it.",
        (Change("camera.events.camera", "[np.exp(-on), np.exp(off),", "[np.exp(-1.03 * on), np.exp(1.03 * off),"),),
        (
            "camera/test_events.py::test_a_ramp_has_events_where_its_logarithm_passes_a_threshold",
            "camera/test_events.py::test_a_sine_has_events_up_and_down",
        ),
    ),
    "contrast for logarithm": Fault(
        "An event camera reports when its light has changed by a fraction, and not when its logarithm has.",
        (Change("camera.events.camera", "[np.exp(-on), np.exp(off),", "[1.0 - on, 1.0 + off,"),),
        (
            "camera/test_events.py::test_a_ramp_has_events_where_its_logarithm_passes_a_threshold",
            "studies/test_event_twin.py::test_the_camera_has_the_events_of_its_twin_and_a_valley_at_the_focus",
        ),
    ),
    "reset ignored": Fault(
        "A pixel of an event camera goes on comparing while it is held in reset.",
        (Change("camera.events.camera", "sensor.refractory_s * noise.refractory", "0.0 * noise.refractory"),),
        (
            "camera/test_events.py::test_in_reset_a_pixel_sees_nothing_and_then_stores_the_level_that_it_has",
            "camera/test_events.py::test_a_step_within_the_reset_is_lost",
        ),
    ),
    "queue forgotten": Fault(
        "The readout of an event camera forgets from one block of time to the next what still waits for it.",
        (
            Change(
                "camera.events.camera", "return self._hand_over(", "self._bus_free = -np.inf; return self._hand_over("
            ),
        ),
        (
            "camera/test_events.py::test_the_queue_goes_on_from_one_piece_of_time_to_the_next",
            "camera/test_events.py::test_no_pixel_fires_in_its_reset_and_none_after_the_end",
        ),
    ),
    "waiting pixels fire": Fault(
        "A pixel of an event camera goes on while its event waits for the readout.",
        (Change("camera.events.kernel", "if read[count] - at > TICK_S:", "if read[count] - at > 1e9 * TICK_S:"),),
        (
            "camera/test_events.py::test_events_wait_as_the_queue_says",
            "camera/test_events.py::test_flicker_that_is_too_fast_for_the_bus_gives_no_event_after_the_end",
        ),
    ),
    "pictures dropped": Fault(
        "Cells of time do not end where a lens, or a sequence of pictures, passes a knot.",
        (
            Change("camera.events.camera", "parts=max(knots - 1, 1)", "parts=1"),
            Change("camera.course", "> 1.0 + KNOT_TOLERANCE", "> 1e9 + KNOT_TOLERANCE"),
        ),
        (
            "camera/test_events.py::test_no_picture_is_dropped",
            "camera/test_events.py::test_a_lens_that_passes_many_knots_in_a_cell_sees_each_of_them",
        ),
    ),
    "polarity flipped": Fault(
        "An event camera reports a rise of the light as a fall.",
        (Change("camera.events.camera", "np.uint16), rises)", "np.uint16), ~rises)"),),
        (
            "camera/test_events.py::test_a_ramp_has_events_where_its_logarithm_passes_a_threshold",
            "camera/test_events.py::test_a_step_has_all_its_events_when_it_happens",
        ),
    ),
    "polarities swapped": Fault(
        "A search sees the rises of an event camera as falls.",
        (Change("stream.event_file", "(held.p > 0)", "(held.p == 0)"),),
        (
            "plugins/test_searches_on_events.py::test_consecutive_windows_share_no_polarity_and_their_sum_is_the_count",
            "benchmark/test_guests_on_events.py::test_a_guest_sees_the_polarities_that_a_search_of_ours_sees",
        ),
    ),
    "pixels forget": Fault(
        "The pixels of a running event camera begin anew each time that a method looks.",
        (Change("benchmark.view.captured", "in self._camera.expose(", "in self._start().expose("),),
        (
            "benchmark/test_closed_loop_events.py::test_events_do_not_depend_on_how_often_a_method_looks",
            "benchmark/test_closed_loop_events.py::test_a_lens_on_the_recorded_path_gives_the_recorded_events",
        ),
    ),
    "dim light at once": Fault(
        "The photoreceptor of an event camera follows dim light as fast as bright light.",
        (Change("camera.events.kernel", "receptor_s + receptor_e / mean", "receptor_s + receptor_e / 1e6"),),
        (
            "camera/test_events.py::test_a_step_is_followed_as_the_closed_form_says",
            "camera/test_events.py::test_smooth_light_is_followed_as_a_solver_says",
        ),
    ),
    "dead time ignored": Fault(
        "A single-photon pixel that recharges itself can fire again at once.",
        (Change("camera.photons.sensor", "self.dead_time_s * self.readout_hz", "0.0 * self.readout_hz"),),
        (
            "camera/test_spad.py::test_in_the_brightest_light_a_pixel_fires_once_per_dead_time",
            "camera/test_spad.py::test_dead_time_is_stated_in_frames",
        ),
    ),
    "dead time of half": Fault(
        "A single-photon pixel is blind for half of its dead time.",
        (Change("camera.photons.kernel", "now += dead\n", "now += 0.5 * dead\n"),),
        (
            "camera/test_spad.py::test_dead_time_empties_frames_as_a_renewal_process_does",
            f"{EACH_LAW}[photons_dead_time]",
        ),
    ),
    "gate ignored": Fault(
        "A single-photon array collects light while its gate is closed.",
        (Change("camera.photons.camera", "weight * np.float32(sensor.gate)", "weight * np.float32(1.0)"),),
        (
            "camera/test_spad.py::test_a_shorter_gate_detects_as_many_fewer",
            "stack/test_recapture.py::test_as_many_photons_are_detected_as_the_light_has",
        ),
    ),
    "dark counts behind the gate": Fault(
        "A single-photon array counts dark counts for the whole frame, also while its gate is closed.",
        (Change("camera.photons.sensor", "self.dark_hz * self.gate / self", "self.dark_hz / self"),),
        (
            "camera/test_spad.py::test_dark_counts_come_only_while_the_gate_is_open",
            "camera/test_spad.py::test_dark_counts_add_to_the_photons_of_the_open_gate",
        ),
    ),
    "OFF thresholds alike": Fault(
        "The thresholds of falling light do not differ between the pixels of an event camera.",
        (Change("camera.events.camera", "sensor.threshold_off + spread", "sensor.threshold_off + 0.0 * spread"),),
        (
            "camera/test_events.py::test_thresholds_of_either_polarity_are_normal_over_the_pixels",
            "camera/test_events.py::test_the_two_thresholds_of_a_pixel_are_independent",
        ),
    ),
    "leaks of a median": Fault(
        "The stated rate of leaks is the median over the pixels of an event camera, so that their mean is larger.",
        (Change("camera.events.camera", "- 0.5 * sd**2)", "- 0.0 * sd**2)"),),
        (
            "camera/test_events.py::test_the_mean_of_the_leaks_is_the_stated_rate_however_much_pixels_differ",
            "camera/test_events.py::test_leaks_are_log_normal_over_the_pixels",
        ),
    ),
    "rolling skew reversed": Fault(
        "A rolling shutter begins with the last row.",
        (
            Change(
                "camera.frames.sensor", "np.arange(self.rows) * self.row_s", "np.arange(self.rows)[::-1] * self.row_s"
            ),
        ),
        (
            "stack/test_frame_capture.py::test_rows_of_a_rolling_shutter_are_exposed_one_after_the_other",
            "stack/test_frame_capture.py::test_in_rising_light_the_lower_rows_of_a_rolling_shutter_are_brighter",
        ),
    ),
    "read noise twice": Fault(
        "A frame camera reads with twice its noise.",
        (Change("camera.frames.camera", "* sensor.read_noise_e", "* (2 * sensor.read_noise_e)"),),
        (
            "camera/test_frames.py::test_photon_transfer_is_that_of_shot_read_and_quantisation_noise",
            f"{EACH_LAW}[frames_photon_transfer]",
        ),
    ),
    "black level forgotten": Fault(
        "A frame camera reads 0 without light, so that read noise is cut off there.",
        (Change("camera.frames.camera", "float(sensor.black_level_dn)", "0.0"),),
        (
            "camera/test_frames.py::test_noise_in_the_dark_is_about_the_black_level_and_not_cut_off",
            "camera/test_frames.py::test_photon_transfer_is_that_of_shot_read_and_quantisation_noise",
            f"{EACH_LAW}[frames_dark]",
        ),
    ),
    "black level left in": Fault(
        "What measures get of a frame camera still holds its black level, as if it were light.",
        (Change("stream.frame_file", "return np.maximum(frames, black) - black", "return frames"),),
        (
            "stack/test_frame_capture.py::test_windows_are_of_the_light_above_the_black_level_that_the_file_keeps",
            "stack/test_frame_capture.py::test_a_frame_holds_the_light_of_its_exposure",
        ),
    ),
    "import flipped": Fault(
        "Raw frames are read upside down, both those whose top row comes first and those whose bottom row does.",
        (Change("stream.interop.raw_frames", "- y if flip else y", "- y if not flip else y"),),
        (
            "stream/test_interop.py::test_fewer_frames_are_the_first_ones",
            "stream/test_interop.py::test_the_first_row_of_a_file_is_the_top_one_but_for_dense",
        ),
    ),
    "aperture +3 %": Fault(
        "Rays pass through an aperture that is 3 % wider than that of the lens.",
        (
            Change("render.camera_rays", "(lens) * radius\n", "(lens) * (radius * 1.03)\n"),
            Change(
                "render.camera_rays",
                "radius=drive.aperture_radius_m, positions",
                "radius=1.03 * drive.aperture_radius_m, positions",
            ),
        ),
        (
            "render/test_camera_rays.py::test_the_rays_of_a_position_fill_its_aperture_evenly",
            f"{EACH_LAW}[optics_blur]",
        ),
    ),
    "Gaussian pupil": Fault(
        "Rays are normally distributed over the lens, with the same variance, instead of evenly over a disc.",
        (
            Change(
                "render.camera_rays",
                "mi.warp.square_to_uniform_disk_concentric(lens) * radius\n",
                "mi.warp.square_to_std_normal(lens) * (radius / 2)\n",
            ),
        ),
        (
            "render/test_camera_rays.py::test_the_rays_of_a_position_fill_its_aperture_evenly",
            f"{EACH_LAW}[optics_transfer]",
        ),
    ),
    "noise repeating by block": Fault(
        "Every block of 64 pixels draws the same noise.",
        (Change("camera.encoder_kernel", "mixed_word(U(key) + block * STRIDE)", "mixed_word(U(key) + start * U(0))"),),
        (
            "camera/test_independent_noise.py::test_pixels_that_fire_together_draw_independent_thresholds",
            f"{EACH_LAW}[noise_independence]",
        ),
    ),
    "charge +1 %": Fault(
        "Light gives 1 % more electrons than it should.",
        (Change("camera.exposure", "return energy * sensor", "return 1.01 * energy * sensor"),),
        (
            "camera/test_exposure.py::test_electrons_are_photons_times_quantum_efficiency_and_fill_factor",
            f"{EACH_LAW}[radiometry_f_number]",
        ),
    ),
    "slices of another seed": Fault(
        "Each time slice has different camera rays, so that the remaining noise flickers where nothing moves.",
        (Change("render", '"stack", base.key, "pictures"', '"stack", spec.key, "pictures"'),),
        (
            "render/test_slices_share_rays.py::test_slices_of_a_static_scene_are_equal_if_the_same_paths_give_the_shading",
            "render/test_slices_share_rays.py::test_a_still_scene_shows_no_beat_with_its_slices",
        ),
    ),
    "interpolation in time reversed": Fault(
        "Between two time slices, the earlier one fades in and the later one fades out.",
        (
            Change(
                "stack.time_resolved",
                "later = (frames + 0.5 - starts[before]) /",
                "later = 1 - (frames + 0.5 - starts[before]) /",
            ),
        ),
        (
            "stack/test_time_resolved.py::test_what_the_encoder_gets_is_the_picture_of_every_readout",
            "generate/test_recorded_spikes.py::test_light_that_grows_evenly_from_slice_to_slice_grows_evenly_in_spikes",
            f"{EACH_LAW}[crossfade_dip]",
        ),
    ),
    "truth from the frame's centre": Fault(
        "The truth of a still scene is the focus of the middle of the picture, not of the target.",
        (
            Change(
                "stack.true_focus",
                "best = _in_focus(time_stack.specs[0], blend).true_focus(depth, target)",
                "best = time_stack.specs[0].drive.least_blur(depth[depth.shape[0] // 2, depth.shape[1] // 2])",
            ),
        ),
        (
            "stack/test_true_focus.py::test_the_truth_of_a_still_target_is_the_compromise_of_its_own_depths",
            f"{EACH_LAW}[truth_depths]",
        ),
    ),
    "aberrations of the other sign": Fault(
        "The rays of a lens with aberrations are turned the other way, so that it is sharp on the other side.",
        (
            Change(
                "render.camera_rays",
                "slope_x + turned[0], slope_y + turned[1]",
                "slope_x - turned[0], slope_y - turned[1]",
            ),
        ),
        (
            "render/test_aberrated_pictures.py::test_rays_are_turned_in_front_of_the_lens_and_nowhere_else[focal_length]",
            "render/test_aberrated_pictures.py::test_astigmatism_parts_the_foci_of_edges_across_and_along[0--10.0]",
            "render/test_focus_of_aberrated_pictures.py::test_the_dispersion_of_pictures_peaks_where_the_pupil_says",
            f"{EACH_LAW}[lens_aberrations]",
        ),
    ),
    "a real lens with its pupils in one place": Fault(
        "The rays of a lens read from a file start at the point of a perfect entrance pupil.",
        (Change("render.camera_rays", "a + mi.Vector2f(*moved), slope_x + bent[0]", "a, slope_x + bent[0]"),),
        (
            "addons/lens_files/test_rendered_lenses.py::"
            "test_rays_leave_the_lens_as_they_do_when_traced_through_its_surfaces",
            "addons/lens_files/test_rendered_lenses.py::test_an_edge_is_the_sum_of_traced_rays",
            f"{EACH_LAW}[lens_double_gauss]",
        ),
    ),
    "a real lens with one pupil for both": Fault(
        "The slope behind a lens read from a file is taken at the point of the entrance pupil, not of the exit pupil.",
        (Change("optics.fitted_rays", "on * (1 / self.pupil_magnification)", "on"),),
        (
            "addons/lens_files/test_lens_files.py::"
            "test_rays_of_the_card_land_on_their_pixel_when_traced_through_the_surfaces",
            "addons/lens_files/test_lens_files.py::test_the_fit_of_a_shipped_lens_is_within_a_twentieth_of_a_pixel",
            "addons/lens_files/test_lens_files.py::test_the_least_blur_is_that_of_the_traced_spot",
        ),
    ),
    "colour of a lens file of the other sign": Fault(
        "A lens read from a file focuses blue light where it focuses red.",
        (Change("optics.lens_colour", "1 - drive.focal_length_m *", "1 + drive.focal_length_m *"),),
        (
            "addons/lens_files/test_lens_colour.py::"
            "test_the_focus_on_the_axis_moves_as_that_of_rays_through_the_surfaces",
            "render/test_coloured_pictures.py::"
            "test_the_focus_of_a_lens_file_in_lamplight_is_that_of_its_rays_of_each_wavelength",
        ),
    ),
    "axial colour of the other sign": Fault(
        "Light whose focus is nearer is drawn as if its focus were farther.",
        (
            Change(
                "optics.axial_colour",
                "defocus=-np.asarray(shift, dtype=np.float64)",
                "defocus=np.asarray(shift, dtype=np.float64)",
            ),
        ),
        (
            "optics/test_axial_colour.py::test_the_rays_of_other_light_are_those_of_another_position[focal_length]",
            "render/test_coloured_pictures.py::"
            "test_the_focus_under_tungsten_and_led_is_that_of_pictures_of_each_wavelength[image_distance]",
            f"{EACH_LAW}[colour_focus]",
        ),
    ),
    "lamps by watts": Fault(
        "A lux of any lamp has the same power, not the same effect on the eye.",
        (Change("core.spectrum", "float(power @ luminous_efficiency())\n\n", "float(power.sum())\n\n"),),
        ("core/test_spectrum.py::test_every_lamp_gives_the_light_of_one_watt_at_555_nm", f"{EACH_LAW}[colour_focus]"),
    ),
    "truth of colour of the other sign": Fault(
        "The truth of blended light is on the other side of that of one wavelength.",
        (Change("optics.texture_contrast", "np.exp(-1j * np.outer(", "np.exp(1j * np.outer("),),
        (
            "optics/test_axial_colour.py::test_the_focus_of_blended_light_is_that_of_an_own_integral"
            "[light0-focal_length]",
            "stack/test_colour.py::test_the_truth_is_where_mixed_pictures_are_sharpest",
        ),
    ),
    "waves before the focus for waves beyond": Fault(
        "The waves of a thin section are defocused the other way, so what is bright on one side of the focus is dark.",
        (Change("optics.partial_coherence", "turn = np.pi", "turn = -np.pi"),),
        (
            "optics/test_partial_coherence.py::test_weak_sections_have_the_transfer_of_the_sum_over_the_condenser",
            "optics/test_partial_coherence.py::"
            "test_what_delays_light_is_bright_when_the_plane_in_focus_is_between_it_and_the_lens",
            "optics/test_partial_coherence.py::test_in_coherent_light_a_phase_grating_makes_the_sum_of_its_orders",
            f"{EACH_LAW}[section_transfer]",
        ),
    ),
    "moving truth from all depths": Fault(
        "The truth of a moving scene is the best compromise over all pixels, not over those of the target.",
        (
            Change(
                "stack.true_focus",
                "best_positions.append(_in_focus(spec, usual).true_focus(depth, target))",
                "best_positions.append(_in_focus(spec, usual).true_focus(depth, np.ones_like(target)))",
            ),
        ),
        (
            "stack/test_true_focus.py::test_the_truth_of_a_moving_target_follows_its_own_depths",
            "generate/test_recorded_spikes.py::test_a_recording_is_sharpest_in_the_frame_of_its_truth[moving]",
        ),
    ),
    "depth of focus from all depths": Fault(
        "The depth of focus is that of the best compromise over all pixels, not over those of the target.",
        (Change("stack.true_focus", "depth_of_focus(depth, target)", "depth_of_focus(depth, np.ones_like(target))"),),
        (
            "stack/test_true_focus.py::test_the_depth_of_focus_of_a_moving_target_is_round_about_its_own_depths",
            "generate/test_recorded_spikes.py::test_a_target_is_blurred_alike_by_a_pixel_at_both_ends_of_its_depth_of_focus",
        ),
    ),
    "exposed at another moment": Fault(
        "A moving target that is never in focus is exposed in the middle frame, under a mask of another moment.",
        (Change("stack.true_focus", "else nearest - 0.5", "else position.size / 2"),),
        (
            "generate/test_exposure_of_moving_scenes.py::test_the_target_fires_as_asked_at_the_moment_of_its_mask",
            "generate/test_exposure_of_moving_scenes.py::test_a_target_that_was_in_sight_only_once_is_exposed_there",
        ),
    ),
    "outlines move with what is behind them": Fault(
        "In time slices, the fraction that a layer covers is counted where its paths are moved to; no pixel is plain.",
        (
            Change("render.layered_splat", "count if layer == SIDE_LAYERS else all_landed", "count"),
            Change("render.layered_splat", "numbers[layer] > SIDE_LAYERS", "numbers[layer] > LAYERS"),
        ),
        (
            "render/test_layered_splat.py::test_an_edge_before_a_blurred_wall_has_its_own_blur_and_place",
            "render/test_edges_in_slices.py::test_edges_in_a_time_slice_are_those_of_the_scene_at_rest",
        ),
    ),
    "smoothing doubled": Fault(
        "Layers of time slices are smoothed by Gaussians that are twice as wide.",
        (Change("render.layered_splat", "SMOOTHING = 0.2 ", "SMOOTHING = 0.4 "),),
        (
            "render/test_layered_splat.py::test_an_edge_within_a_blurred_surface_has_the_blur_of_the_surface",
            "render/test_edges_in_slices.py::test_edges_in_a_time_slice_are_those_of_the_scene_at_rest",
        ),
    ),
    "coverage smoothed twice as much": Fault(
        "The fraction that a layer of a time slice covers is smoothed by Gaussians that are twice as wide.",
        (Change("render.layered_splat", "COVERAGE_SMOOTHING = 0.1 ", "COVERAGE_SMOOTHING = 0.2 "),),
        (
            "render/test_layered_splat.py::test_an_edge_before_a_blurred_wall_has_its_own_blur_and_place",
            "render/test_edges_in_slices.py::test_edges_in_a_time_slice_are_those_of_the_scene_at_rest",
        ),
    ),
    "sight ends at glass": Fault(
        "Lines of sight end at the first clear surface, so that a target behind glass is not seen.",
        (Change("render.pinhole_sight", "active[~target & (invisible | is_clear)]", "active[~target & invisible]"),),
        (
            "render/test_pinhole_sight.py::test_a_window_of_thickness_t_brings_the_target_nearer_by_t_times_1_minus_1_by_n",
            "render/test_pinhole_sight.py::test_a_target_behind_what_lets_light_straight_through_is_seen_at_its_own_depth",
        ),
    ),
    "true depth behind glass": Fault(
        "The depth of a target behind glass is that of its surface, not that at which it appears.",
        (
            Change(
                "render.pinhole_sight", "np.where(mean > 0, 1 / mean, np.nan)", "np.where(mean > 0, distance, np.nan)"
            ),
        ),
        (
            "render/test_pinhole_sight.py::test_a_window_of_thickness_t_brings_the_target_nearer_by_t_times_1_minus_1_by_n",
            "render/test_pinhole_sight.py::test_a_ball_lens_before_the_target_magnifies_its_depth_by_the_thick_lens_formula",
        ),
    ),
    "invisible targets count": Fault(
        "A null surface, the boundary of fog and a mask of opacity 0 are seen.",
        (Change("render.pinhole_sight", "(met.through >= INVISIBLE)", "(met.through > 2)"),),
        (
            "render/test_pinhole_sight.py::test_an_invisible_target_is_not_visible",
            "render/test_pinhole_sight.py::test_depth_is_that_of_the_first_visible_surface",
        ),
    ),
    "ring behind the lens": Fault(
        "Rays are followed to the ring as if it were as far behind the lens, without refraction.",
        (
            Change(
                "optics.vignetting",
                "a[0] + slope[0] * distance, a[1] + slope[1]",
                "a[0] - slope[0] * distance, a[1] - slope[1]",
            ),
        ),
        (
            "render/test_vignetted_pictures.py::test_an_even_field_darkens_by_the_overlap_of_the_discs",
            "render/test_vignetted_pictures.py::test_a_lamp_out_of_focus_is_a_cats_eye_of_the_overlap",
            f"{EACH_LAW}[lens_vignetting]",
        ),
    ),
    "barrel for pincushion": Fault(
        "Rays of a lens with distortion are turned the other way, in the picture, its depth and its target.",
        (Change("optics.distortion", "number(-self.per_slope_squared)", "number(self.per_slope_squared)"),),
        (
            "optics/test_distortion.py::test_the_turn_is_the_gradient_of_seidels_fifth_sum_whatever_the_point_of_the_aperture",
            "render/test_distorted_pictures.py::test_stripes_are_where_the_closed_form_displaces_them",
            "render/test_distorted_pictures.py::test_depth_and_target_are_where_the_distorted_picture_has_them",
            f"{EACH_LAW}[lens_distortion]",
        ),
    ),
    "glare lost": Fault(
        "The light that veiling glare takes from the picture is not spread over it, but lost.",
        (Change("camera.exposure", "picture += np.float32(share * mean)", "picture += np.float32(0 * mean)"),),
        (
            "camera/test_exposure.py::test_glare_is_a_share_of_the_frames_light_that_is_spread_evenly_and_none_of_it_is_lost",
            "camera/test_exposure.py::test_glare_is_seen_in_the_spikes_of_a_black_field",
            f"{EACH_LAW}[lens_glare]",
        ),
    ),
    "hysteresis without memory": Fault(
        "At each command, a piezo forgets how it came to its position.",
        (
            Change(
                "optics.actuators.actuated_lens",
                "states = states_at(self._operators, begin)",
                "states = operators_at_rest(position)",
            ),
        ),
        (
            "optics/test_hysteresis.py::test_the_area_of_a_loop_is_that_of_its_play_operators_and_grows_as_the_cube_of_the_stroke",
            "optics/test_actuators.py::test_a_reference_by_brute_force_moves_alike",
            f"{EACH_LAW}[drive_log]",
        ),
    ),
    "no latency": Fault(
        "A drive obeys a command at once.",
        (
            Change(
                "optics.actuators.actuated_lens",
                "begin = self.frames / self.readout_hz + actuator.latency_s\n        position",
                "begin = self.frames / self.readout_hz\n        position",
            ),
        ),
        (
            "optics/test_actuators.py::test_a_command_is_in_force_after_the_latency_to_the_microsecond",
            f"{EACH_LAW}[drive_log]",
        ),
    ),
    "drift without surroundings": Fault(
        "A liquid lens drifts by the heat of its current alone, however warm the room is.",
        (
            Change(
                "optics.actuators.actuated_lens",
                "(drift.ambient_k + drift.heating_k * warmth)",
                "(drift.heating_k * warmth)",
            ),
        ),
        (
            "optics/test_hysteresis.py::test_a_lens_drifts_exponentially_to_the_offset_of_its_new_temperature",
            "optics/test_hysteresis.py::test_a_sensor_at_the_motor_sees_neither_hysteresis_nor_drift",
            f"{EACH_LAW}[drive_log]",
        ),
    ),
    "log of the truth": Fault(
        "The lens log of a recording holds where the lens was, not what its drive was told.",
        (Change("generate.record", "focus_position=log.astype", "focus_position=position.astype"),),
        (
            "generate/test_driven_lens.py::test_the_log_is_what_a_piezo_was_told_and_the_truth_where_it_was",
            "generate/test_driven_lens.py::test_methods_see_the_log_alone",
            f"{EACH_LAW}[drive_log]",
        ),
    ),
    "judged by the log": Fault(
        "Answers on recordings are judged by the lens log, not by where the lens was.",
        (
            Change(
                "stream.metadata",
                "self.focus_position if self.truth.lens is None else",
                "self.focus_position if True else",
            ),
        ),
        (
            "generate/test_driven_lens.py::test_the_log_is_what_a_piezo_was_told_and_the_truth_where_it_was",
            "generate/test_driven_lens.py::test_a_part_keeps_its_part_of_the_truth",
            "benchmark/test_evaluate.py::test_an_answer_is_judged_by_where_the_lens_was_and_not_by_its_log",
        ),
    ),
    "in focus for half as long": Fault(
        "By contrast, a lens with aberrations is in focus until it lost what a perfect lens loses over half as far.",
        (Change("optics.best_focus", "perfect.at(np.array(half))", "perfect.at(np.array(half / 2))"),),
        (
            "optics/test_in_focus.py::test_contrast_has_fallen_as_that_of_a_perfect_lens_at_the_ends",
            "optics/test_in_focus.py::test_a_weak_aberration_is_in_focus_for_as_long_as_a_perfect_lens",
        ),
    ),
    "blur that is left is forgotten": Fault(
        "By blur, a lens with aberrations or colour is in focus as if its least blur were none.",
        (Change("optics.best_focus", "np.sqrt(1 + 2 * curve.left / half)", "np.sqrt(1 + 0 * curve.left)"),),
        (
            "optics/test_in_focus.py::test_blur_has_grown_by_a_resolved_width_at_the_ends",
            "optics/test_in_focus.py::test_colour_blurs_by_the_scatter_of_its_foci",
        ),
    ),
    "tilted targets taken for flat ones": Fault(
        "A tilted target is in focus only where the middle one of its pixels is.",
        (Change("core.region", "for share in (0.1, 0.9))", "for share in (0.5, 0.5))"),),
        (
            "optics/test_in_focus.py::test_a_slanted_plane_is_in_focus_from_its_first_to_its_last_decile",
            "optics/test_in_focus.py::test_the_deciles_of_a_slanted_plane_have_the_closed_form",
            "stack/test_noise_free.py::test_whole_targets_of_recordings_follow_from_what_they_hold",
        ),
    ),
    "optima that are positions": Fault(
        "Recordings state where the curves of measures peak, and readers take it for the distance from the truth.",
        (Change("stack.noise_free", "optima[name] = peak - truth.position", "optima[name] = peak"),),
        (
            "stack/test_noise_free.py::test_each_measure_peaks_where_its_weights_of_two_stripes_say",
            "stack/test_noise_free.py::test_optima_are_stored_beside_the_content_which_keeps_its_digest",
        ),
    ),
    "fitted peak on the other side": Fault(
        "The peak of the curve of slices is on the other side of its largest value.",
        (Change("stream.optima", "peak = float(-slope / (2 * bend))", "peak = float(slope / (2 * bend))"),),
        (
            "stack/test_noise_free.py::test_a_fitted_peak_stands_scatter_and_says_when_it_does_not",
            "stack/test_noise_free.py::test_in_a_moving_scene_the_peak_of_sd_is_off_the_moving_truth",
        ),
    ),
    "abstaining ranks": Fault(
        "Silence where there is no answer counts as success, as it did in the second edition of the benchmark.",
        (
            Change(
                "leaderboard.ranking",
                "if not record.answerable:\n            return None\n        return float("
                'record.judgement.status == "answered" and record.success(limit_dof) is True)',
                "if record.answerable is None:\n            return None\n        return float("
                "record.success(limit_dof) is True)",
            ),
        ),
        (
            "leaderboard/test_leaderboard.py::test_a_method_that_only_abstains_better_has_the_same_rank",
            "leaderboard/test_leaderboard.py::test_where_no_sequence_has_an_answer_nobody_ranks",
        ),
    ),
    "nothing is rejected": Fault(
        "A search that may abstain answers where its sweep never comes near the focus.",
        (Change("plugins.searches._reject", 'return found.note if found.frame is None else ""', 'return ""'),),
        (
            "plugins/test_reject.py::test_a_sweep_that_ends_far_from_the_focus_has_no_answer",
            "plugins/test_reject.py::test_nobody_abstains_where_peak_fit_answers",
        ),
    ),
    "computing takes no time": Fault(
        "The clock of the closed loop stands still while a method computes.",
        (
            Change(
                "benchmark.view.running_camera", "self.readout_hz / operations_per_s if operations_per_s", "0.0 if True"
            ),
        ),
        (
            "benchmark/test_operations.py::test_the_clock_advances_by_the_operations_at_the_stated_rate",
            "benchmark/test_operations.py::test_the_camera_runs_on_until_what_was_computed_is_done",
        ),
    ),
    "one depth within a whole one": Fault(
        "A region counts as one depth within a depth of focus of the truth, not within half of one.",
        (Change("benchmark.strata", "off <= dof / 2", "off <= dof"),),
        (
            "benchmark/test_strata.py::test_a_plane_is_one_depth_within_half_a_depth_of_focus",
            "benchmark/test_strata.py::test_of_a_tilted_plane_as_many_columns_count_as_are_within_half_a_depth_of_focus",
        ),
    ),
    "false answers are free": Fault(
        "Tuning does not count answers where there is none, so that it chooses methods that never abstain.",
        (Change("leaderboard.tuning", "else -float(is_answered)", "else 0.0"),),
        (
            "leaderboard/test_tuning.py::test_the_objective_counts_answers_where_there_is_none_against_the_method",
            "leaderboard/test_tuning.py::test_the_right_to_abstain_is_chosen_where_some_sweeps_have_no_answer",
        ),
    ),
    "bells by contrast": Fault(
        "All curves are divided by the size of the largest, so that blocks vote by their contrast.",
        (Change("plugins.searches.bell_vote", "np.square(y).sum(axis=0)", "np.square(y).sum(axis=0).max()"),),
        (
            "plugins/test_bell_vote.py::test_the_correlation_is_that_of_each_curve_with_each_bell",
            "plugins/test_bell_vote.py::test_with_area_most_of_the_area_decides_and_otherwise_most_of_the_contrast_does",
        ),
    ),
    "fine structure that sees noise": Fault(
        "The weights of fine structure do not sum to 0, so that noise and shading score.",
        (Change("core.block_structure", "[-4.0, 5.0, 0.0, -1.0]", "[-4.0, 4.5, 0.0, -1.0]"),),
        (
            "plugins/test_structure.py::test_fine_structure_is_the_formula",
            "plugins/test_structure.py::test_fine_structure_sees_neither_noise_nor_shading_but_texture",
        ),
    ),
    "inside to the frame's edge": Fault(
        "The region inside a target reaches the edge of the frame, where blur leaks in from what nobody has seen.",
        (Change("core.region", "np.pad(mask, MARGIN)", "np.pad(mask, MARGIN, constant_values=True)"),),
        (
            "core/test_region_inside.py::test_the_fast_search_finds_what_trying_every_rectangle_finds",
            "core/test_region_inside.py::test_a_full_rectangle_keeps_all_but_its_margin_also_at_the_edge_of_the_frame",
        ),
    ),
    "inside at one moment": Fault(
        "The region inside a target that moves is inside it at one moment alone.",
        (Change("stack.true_focus", "mask = mask & plane_source.load_geometry(j)[1]", "pass"),),
        (
            "stack/test_inside_of_movers.py::test_it_is_what_the_moments_near_the_focus_have_in_common",
            "stack/test_inside_of_movers.py::test_a_target_that_moves_too_far_in_that_time_has_none",
        ),
    ),
    "inside judged by the box": Fault(
        "Methods that look inside the target are held against the noise-free curve of the box around it.",
        (Change("benchmark.tracks.record_of_run", 'if who.region == "inside"', 'if who.region == "outside"'),),
        (
            "benchmark/test_record_of_run.py::"
            "test_a_method_that_looks_inside_the_target_has_the_optimum_and_the_sharpness_of_that_place",
            "benchmark/test_inside_region.py::test_in_the_closed_loop_a_lens_moves_only_where_the_recording_has_it",
        ),
    ),
    "sharpness lost twice": Fault(
        "The sharpness that an answer loses is that of the squared curve.",
        (Change("stream.optima", "1 - here / best", "1 - (here / best) ** 2"),),
        (
            "benchmark/test_record_of_run.py::test_the_sharpness_lost_at_an_answer_is_that_of_the_curve_without_noise",
            "benchmark/test_record_of_run.py::test_a_record_states_the_sharpness_lost_where_it_is_known",
        ),
    ),
    "falls that add to rises": Fault(
        "Reversal adds falls to rises, so that the number of events counts and not what they do to a pixel.",
        (Change("plugins.searches.event_reversal", "block[1] - block[0]", "block[1] + block[0]"),),
        (
            "plugins/test_event_reversal.py::test_the_focus_is_found_at_rest_at_the_ends_of_the_sweep_too",
            "plugins/test_event_reversal.py::test_a_lamp_that_all_pixels_follow_does_not_move_it",
        ),
    ),
}
