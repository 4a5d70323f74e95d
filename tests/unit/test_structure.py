"""Values as plain CBOR: bit for bit there and back, and only what is ours."""

import contextlib
import math
from dataclasses import dataclass

import cbor2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from autonomy.effects import Topic
from autonomy.events import JobFailed, JobFinished, LinkDown, StopRequested
from autonomy.learning.kernel import Component, Kernel
from autonomy.learning.sparse_gp import SparseOnlineGP
from autonomy.learning.spatial import Matern32, SquaredExponential
from autonomy.learning.temporal import MaternMotion
from autonomy.records import RecordDecoder, RecordError
from autonomy.structure import StructureError, decode, deviation, encode, fingerprint

arrays = npst.arrays(
    st.sampled_from(["<f8", "<f4", "<i8", "|u1", "|b1"]),
    npst.array_shapes(min_dims=0, max_dims=3, min_side=0),
)
plain = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.floats()
    | st.text()
    | st.binary()
    | arrays,
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.lists(inner, max_size=4).map(tuple)
        | st.dictionaries(st.text() | st.integers(-(2**31), 2**31), inner, max_size=4)
    ),
    max_leaves=12,
)


def alike(a: object, b: object) -> bool:
    """The same type, and the same to the last bit."""
    if type(a) is not type(b):
        return False
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
    if isinstance(a, float) and isinstance(b, float):
        return (a == b and math.copysign(1, a) == math.copysign(1, b)) or (a != a and b != b)
    if isinstance(a, list | tuple) and isinstance(b, list | tuple):
        return len(a) == len(b) and all(map(alike, a, b))
    if isinstance(a, dict) and isinstance(b, dict):
        return list(a) == list(b) and all(alike(a[key], b[key]) for key in a)
    return a == b


@given(plain)
def test_there_and_back(value: object) -> None:
    assert alike(decode(encode(value)), value)
    assert deviation(value, value) == 0.0
    assert fingerprint(value) == fingerprint(decode(encode(value)))


def test_a_model_goes_on_as_if_it_had_never_been_written_down() -> None:
    """All its state is there: the copy learns the same from the same, to the last bit."""
    slow = Component(1.0, SquaredExponential((300.0, 200.0)))
    kernel = Kernel((slow, Component(0.3, Matern32((80.0, 90.0)), MaternMotion(900.0))), 0.01)
    rng = np.random.default_rng(3)
    gp = SparseOnlineGP(kernel, 20)
    for _ in range(60):
        gp.update(rng.uniform(0, 1000, 2), rng.normal())
        gp.advance(5.0)
    copy = decode(encode(gp))
    for _ in range(40):
        place, value = rng.uniform(0, 1000, 2), rng.normal()
        assert gp.update(place, value) is copy.update(place, value)
        gp.advance(5.0)
        copy.advance(5.0)
    places = rng.uniform(0, 1000, (30, 2))
    np.testing.assert_array_equal(gp.predict(places).mean, copy.predict(places).mean)
    np.testing.assert_array_equal(gp.predict(places).variance, copy.predict(places).variance)


def test_an_array_stored_by_columns_stays_so() -> None:
    """BLAS adds in another order otherwise, and the last bits differ."""
    array = np.asfortranarray(np.arange(12.0).reshape(3, 4))
    assert decode(encode(array)).flags.f_contiguous
    assert decode(encode(array.T)).flags.c_contiguous
    assert decode(encode(array[:, ::2])).tolist() == array[:, ::2].tolist()


def test_a_digest_is_of_everything_and_an_outline_of_all_but_the_numbers() -> None:
    here, near = fingerprint((1.0, "a", np.ones(3))), fingerprint((1.0 + 1e-15, "a", np.ones(3)))
    assert here != near
    assert here.outline == near.outline
    assert here.numbers == (1.0, 3.0, 3.0)
    assert fingerprint((1.0, "b", np.ones(3))).outline != here.outline
    assert fingerprint((1.0, "a", np.ones(4))).outline != here.outline
    assert fingerprint(math.nan) == fingerprint(math.nan)


@pytest.mark.parametrize(
    ("a", "b", "apart"),
    [
        (1.0, 1.5, 1 / 3),
        (np.array([1.0, 4.0]), np.array([1.0, 3.0]), 0.25),
        (np.array([1.0, math.nan]), np.array([1.0, math.nan]), 0.0),
        ((1.0, "a"), (1.0, "b"), math.inf),
        (np.zeros(3), np.zeros(4), math.inf),
        (1.0, None, math.inf),
        ({"a": 2.0}, {"a": 1.0}, 0.5),
        (math.inf, 1.0, math.inf),
        (JobFinished(1, (2.0,)), JobFinished(1, (1.0,)), 0.5),
    ],
)
def test_deviation(a: object, b: object, apart: float) -> None:
    assert deviation(a, b) == pytest.approx(apart)
    assert deviation(b, a) == pytest.approx(apart)


@dataclass
class Foreign:
    a: int = 1


@pytest.mark.parametrize("value", [object(), Foreign(), np.array([object()]), {1, 2}, lambda: None])
def test_what_has_no_form_is_said(value: object) -> None:
    with pytest.raises(TypeError, match="has no form here"):
        encode(value)


def tagged(tag: int, content: object) -> bytes:
    return cbor2.dumps(cbor2.CBORTag(tag, content))


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"", "is not CBOR"),
        (b"\xff", "is not CBOR"),
        (tagged(70_003, ["Popen", {"args": "true"}]), "'Popen' is not one that is read"),
        (tagged(70_003, ["os.system", {}]), "is not one that is read"),
        (tagged(70_003, ["LinkDown", {"nothing": 1}]), "not what its tag 70003 promises"),
        (tagged(70_003, ["Kernel", {"components": [], "noise_variance": -1.0}]), "noise_variance"),
        (tagged(70_001, ["|O", [1], "C", b"12345678"]), "no type of numbers"),
        (tagged(70_001, [",f8", [1], "C", b"12345678"]), "no type of numbers"),
        (tagged(70_001, ["<M8", [1], "C", b"12345678"]), "no type of numbers"),
        (tagged(70_001, ["<f9", [1], "C", b"12345678"]), "not what its tag 70001 promises"),
        (tagged(70_001, ["<f8", [10**9, 10**9], "C", b""]), "do not fill"),
        (tagged(70_001, ["<f8", [-1], "C", b""]), "no shape"),
        (tagged(70_005, ["Topic", "MODEL"]), "unknown tag 70005"),
        (tagged(2, b"1"), "is not CBOR"),
        (tagged(35, "(a+)+$"), "is not CBOR"),
        (b"\x81" * 100 + b"\x01", "is not CBOR"),
        (cbor2.dumps({"a": 1}), "a bare"),
    ],
)
def test_what_is_not_ours_is_refused(data: bytes, said: str) -> None:
    with pytest.raises(StructureError, match=said):
        decode(data)


def test_a_member_of_an_enumeration_is_only_written() -> None:
    with pytest.raises(StructureError):
        decode(encode(Topic.MODEL))


SEEDS = [
    encode(value)
    for value in (
        JobFailed(3, "killed"),
        StopRequested(),
        JobFinished(1, (np.eye(2), [1.0], {"a": 2})),
        LinkDown(""),
    )
]


@given(st.sampled_from(SEEDS), st.lists(st.tuples(st.integers(0, 10**6), st.integers(0, 255)), max_size=6))
def test_damaged_bytes_give_a_value_or_the_documented_error(
    seed: bytes, changes: list[tuple[int, int]]
) -> None:
    data = bytearray(seed)
    for place, byte in changes:
        data[place % len(data)] = byte
    with contextlib.suppress(StructureError):
        decode(bytes(data))


@given(
    st.binary(max_size=200)
    | st.sampled_from([0, 1, 2, 3, 4, 9]).flatmap(
        lambda kind: st.lists(plain, max_size=3).map(lambda rest: encode([kind, *rest]))
    )
)
def test_any_payload_is_a_record_or_the_documented_error(payload: bytes) -> None:
    with contextlib.suppress(RecordError):
        RecordDecoder().decode(payload)
