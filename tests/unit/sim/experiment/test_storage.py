"""Cells on disk: exactly what was computed, or nothing."""

import numpy as np
import pytest
import xarray
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from sim.experiment.cells import SweepError
from sim.experiment.storage import CellFolder, decode, encode

NAMES = st.from_regex(r"[A-Za-z][A-Za-z0-9_]{0,12}", fullmatch=True)
KINDS = st.sampled_from(["f4", "f8", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "?"])
SHAPES = arrays.array_shapes(min_dims=1, max_dims=3, min_side=0, max_side=6)
WORDS = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=20)
NUMBERS = st.one_of(st.booleans(), st.integers(-(2**63), 2**63 - 1), st.floats(), WORDS)
VALUES = st.one_of(NUMBERS, KINDS.flatmap(lambda kind: arrays.arrays(kind, SHAPES)))


@settings(max_examples=60, deadline=None)
@given(st.dictionaries(NAMES, VALUES, max_size=5))
def test_values_come_back_to_the_last_bit(values):
    back, _ = decode(encode(values, {}))
    assert set(back) == set(values)
    for name, value in values.items():
        assert type(back[name]) is type(value)
        if isinstance(value, np.ndarray):
            assert (back[name].dtype, back[name].shape) == (value.dtype, value.shape)
            assert back[name].tobytes() == value.tobytes()
        elif isinstance(value, float):
            assert np.float64(back[name]).tobytes() == np.float64(value).tobytes()
        else:
            assert back[name] == value


def test_any_reader_of_netcdf_reads_them(tmp_path):
    file = tmp_path / "cell.nc"
    file.write_bytes(
        encode({"rmse": np.linspace(0, 1, 5), "km": 3.5}, {"arguments": {"seed": 1}, "cell": "a"})
    )
    with xarray.open_dataset(file) as dataset:
        assert dataset["rmse"].values.tolist() == [0.0, 0.25, 0.5, 0.75, 1.0]
        assert float(dataset["km"]) == 3.5
        assert dataset.attrs == {"arguments": '{"seed": 1}', "cell": '"a"'}


@pytest.mark.parametrize(
    "value",
    [None, 1j, [1, "a"], np.array(["a"]), np.datetime64("2026-01-01"), np.float16(1), object(), {"a": 1}],
)
def test_what_is_no_number_is_refused(value):
    with pytest.raises(TypeError, match="'depth' must be a number"):
        encode({"depth": value}, {})


@pytest.mark.parametrize("name", ["", "1st", "a b", "a/b", "_hidden"])
def test_a_name_is_a_word(name):
    with pytest.raises(ValueError, match="must be a word"):
        encode({name: 1.0}, {})


def damage(data: bytes, how: str) -> bytes:
    middle = len(data) // 2
    return {
        "cut": data[:middle],
        "empty": b"",
        "one bit": data[:middle] + bytes([data[middle] ^ 1]) + data[middle + 1 :],
        "longer": data + b"\0",
    }[how]


@pytest.mark.parametrize("how", ["cut", "empty", "one bit", "longer"])
def test_a_damaged_file_is_found_and_replaced(tmp_path, how):
    folder, data = CellFolder(tmp_path), encode({"a": np.arange(9.0)}, {})
    folder.keep("f" * 32, data)
    (file,) = tmp_path.glob("*.nc")
    file.write_bytes(damage(data, how))
    assert folder.load("f" * 32) == (None, [file])
    newer = encode({"a": np.arange(9.0)}, {"finished": "later"})
    folder.keep("f" * 32, newer)
    assert folder.load("f" * 32) == (newer, [])
    assert len(list(tmp_path.iterdir())) == 1


def test_a_folder_holds_one_sweep_at_a_time(tmp_path):
    with CellFolder(tmp_path).held(), pytest.raises(SweepError, match="another sweep"):
        CellFolder(tmp_path).held().__enter__()
    with CellFolder(tmp_path).held():
        pass


def test_a_folder_that_is_none_is_told(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(SweepError, match=r"file.*(exists|directory)"):
        CellFolder(tmp_path / "file").held().__enter__()
