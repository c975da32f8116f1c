from dataclasses import asdict

import yaml

from saf_gen.benchmark.tracks.sequence_fields import sensor_of
from saf_gen.camera import get_sensor


def name(sensor):
    return sensor_of({"sensor": yaml.safe_dump(asdict(sensor), sort_keys=False)})


def test_a_sensor_has_its_name_and_one_of_other_numbers_a_digest_too():
    assert name(get_sensor("vidar_400x250_noisy")) == "vidar_400x250_noisy"
    quiet = name(get_sensor("vidar_400x250", noise={"dark": False}))
    assert quiet.startswith("vidar_400x250#")
    assert len(quiet) == len("vidar_400x250#") + 6
    assert quiet != name(get_sensor("vidar_400x250", rows=100))


def test_a_recording_without_a_sensor_or_with_one_that_cannot_be_read_has_none():
    assert sensor_of({}) is None
    assert sensor_of({"sensor": "pitch_m: ["}) is None
    assert sensor_of({"sensor": "name: mine"}) is None
