"""Whatever users' code raises is an Exception for its caller, but Ctrl-C and what passes on purpose."""

import asyncio
import pickle
import traceback

import pytest
from refusals import refusal

from saf_gen.core.user_code import CodeStopped, PassesUserCode, named_user_code, user_code
from saf_gen.errors import BadInput
from saf_gen.plugins.lights import group_gains
from saf_gen.plugins.motions import lens_positions


class Panic(BaseException):
    """What PyO3 raises if Rust panics."""


def stop(error):
    raise error


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (SystemExit(), "its code called exit()"),
        (SystemExit(0), "its code called exit(0)"),
        (SystemExit("no\nlicence"), r"its code called exit('no\nlicence')"),
        (GeneratorExit(), "its code raised GeneratorExit: "),
        (asyncio.CancelledError("late"), "its code raised CancelledError: late"),
        (Panic("index out of bounds"), "its code raised Panic: index out of bounds"),
    ],
)
def test_what_is_no_exception_becomes_one_that_shows_where_it_was_raised(error, message):
    with pytest.raises(CodeStopped) as caught, user_code():
        stop(error)
    assert str(caught.value) == message
    assert caught.value.__cause__ is error
    assert traceback.extract_tb(caught.value.__traceback__)[-1].name == "stop"
    assert str(pickle.loads(pickle.dumps(caught.value))) == message


@pytest.mark.parametrize("error", [KeyboardInterrupt(), PassesUserCode(), ValueError("x"), BadInput("x")])
def test_exceptions_and_ctrl_c_stay_as_they_are(error):
    with pytest.raises(type(error)) as caught, user_code():
        stop(error)
    assert caught.value is error


@pytest.mark.parametrize("error", [SystemExit(3), ValueError("three")])
def test_a_failure_of_named_code_is_one_line(error):
    def run():
        with named_user_code("mine", "focus measure"):
            stop(error)

    told = "CodeStopped: its code called exit(3)" if isinstance(error, SystemExit) else "ValueError: three"
    assert str(refusal(run)) == f"focus measure 'mine' fails: {told}; repair it"


# Light schedules and motions, which recipes name


class ExitsWhenBuilt:
    def __init__(self, code=3):
        raise SystemExit(code)

    def integral(self, seconds, duration_s):
        return seconds

    positions = integral


class ExitsWhenUsed:
    def integral(self, seconds, duration_s):
        raise SystemExit(3)

    positions = integral


USES = {
    "lights": lambda name: group_gains({"": {"kind": name}}, ["lamp"], frames=8, readout_hz=20_000),
    "motions": lambda name: lens_positions({"kind": name}, 8, readout_hz=20_000),
}


@pytest.mark.parametrize("plugin_kind", USES)
@pytest.mark.parametrize("plain", [ExitsWhenBuilt, ExitsWhenUsed])
def test_an_exit_of_a_light_or_a_motion_is_one_line_that_names_it(plugin_kind, plain):
    message = str(refusal(USES[plugin_kind], f"{__name__}:{plain.__name__}"))
    assert plain.__name__ in message
    assert "CodeStopped: its code called exit(3)" in message
