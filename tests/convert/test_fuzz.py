"""Any bytes: a reader gives what it says, or one sentence."""

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from scan2flex_jax.convert import quantity, read_foreign_curve, read_frames
from scan2flex_jax.errors import Scan2FlexError

NUMBERS = st.one_of(
    st.floats().map(repr), st.sampled_from(["0", "1,5", "nan", "-inf", "1e999", "", "x", "1_0", '"2"', "٣", "sag start", "[1"])
)
ROWS = st.lists(st.lists(NUMBERS, min_size=1, max_size=7), max_size=8)
HEADERS = st.sampled_from(
    ["", "x,y,z", "s;x;y;z", "name,x,y,z,qw,qx,qy,qz", "pose,end,x,y,z,a,b,c", "x_mm y_mm z_mm", "#", "x,x,x", "\ufeffx,y,z"]
)
TEXTS = st.builds(
    lambda header, rows, mark: "\n".join([header, *(mark.join(row) for row in rows)]).encode(),
    HEADERS, ROWS, st.sampled_from([",", ";", "\t", " ", ", "]),
)  # fmt: skip
HURRIED = settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@HURRIED
@given(data=st.one_of(TEXTS, st.binary(max_size=200)), units=st.sampled_from([None, "mm", "yard"]))
def test_readers_of_other_tools(tmp_path, data, units):
    file = tmp_path / "given.csv"
    file.write_bytes(data)
    for read in (
        lambda: read_foreign_curve(file, units=units).curve.points,
        lambda: [c.position for c in read_frames(file, units=units or "m", convention="kuka").values()],
    ):
        try:
            assert np.all(np.isfinite(read()))
        except Scan2FlexError as error:
            assert str(error)
            assert "\n" not in str(error)


@HURRIED
@given(text=st.text(max_size=12))
def test_quantities(text):
    try:
        assert quantity(text, "length") > 0
    except Scan2FlexError as error:
        assert "\n" not in str(error)
