"""An error is one line, whatever its parts contain."""

import pickle

from saf_gen.errors import BadInput, closest, unknown


def test_at_most_eight_names_are_allowed_in_a_line_those_nearest_to_the_value():
    names = [f"lens_{number}" for number in range(30)]
    error = unknown("lens", "lens_17x", allowed=names)
    assert error.allowed.count("lens_") == 8
    assert "lens_17" in error.allowed
    assert error.allowed.endswith(" and 22 more")
    assert unknown("lens", "x", allowed=names[:8]).allowed == ", ".join(names[:8])


def test_a_message_is_one_line_with_value_allowed_nearest_and_next_step():
    error = BadInput("mode is 'x'", where="a.yaml:3", allowed="y, z", nearest="y", hint="see\n  the docs")
    assert str(error) == "a.yaml:3: mode is 'x'; allowed: y, z; did you mean 'y'?; see the docs"


def test_an_unknown_name_is_refused_with_the_nearest_known_one():
    text = str(unknown("measure", "sd_cod", allowed=["sd_code", "er_count"]))
    assert text == "unknown measure 'sd_cod'; allowed: er_count, sd_code; did you mean 'sd_code'?"


def test_nothing_is_suggested_when_nothing_is_near():
    assert closest("zzz", ["sd_code"]) == ""


def test_an_error_crosses_a_process_border_unchanged():
    error = BadInput("value", where="here", allowed="that", nearest="this", hint="do")
    again = pickle.loads(pickle.dumps(error))
    assert str(again) == str(error)
    assert again.exit_code == 2
