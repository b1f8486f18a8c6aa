"""Tests of LeRobot's pickles: what torch makes is read, what LeRobot loads is written, and nothing is ever run."""

from __future__ import annotations

import base64
import os
import pickle
import zlib
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.errors import Code, GatewayError, Rejected
from gateway.policy.pickled import as_stock, timed_actions
from tests.policy.lerobot_server import loaded, pickled

ROWS = np.arange(12, dtype="<f4").reshape(3, 4)
GOLDEN = (
    "eNrtUs1r1EAczVez2922lBYET3qMl4Dd0sVT11LaQ/CresilDNlk2hmZncl8pLCFhfSwoJKb482DF8F/zf9AwYO/3UjxsIh/QIfM"
    "hLy8eXnzXurg09fAWY5zGzUPGFZiLEyc6SnPEeUXWGGe45hgVmKlbdN/Qye4eJobKrj9aB/d2BnsWzeAapNNSnt6+KPVa7otiEub"
    "dJowa7c0G0aonMSoMpSB3g5SeFxRViCDuRYKXe2BbNRstjQNt+wS22YbMZEV6EKJCRpPDdbAOtp1Haf2PvTYr88nPx++/fbyflx7"
    "z777sM6kE6XbYKNUwohcMHQF/sGBdIGQbsIbRo1hGGFe0IxL713aA9BMS4w0vcZa+jMZROkagJoIZeRa4qU+PFFuZJgE6SI3Jvil"
    "7CRBVcE3o7SzILeWpZMvj9A7AePmdQv2pJtuAefJ/mB/+PhgMNwbDIYHstXNy0r6SfjcyOAVqJ1LZxXXzeLQ+XvUh7CM4IJZw/wy"
    "snN7ZhMn8eY2cef2fdOH8zO8LGBR4QtVQK3FMc3NosIza4BfjYnftknC09Gff4J0ki7pkn5Etu7C/lfY3m3Y5N7KQDduA12/C/Q/"
    "Ag1WBYrj344EU1M="
)
"""Three TimedAction of LeRobot 0.6.1 with rows of `torch.arange(6.0).reshape(3, 2)`, pickled with torch 2.11; zlib, base 64."""
BRAIN = (
    "eNptkTFP3DAUx5Nc4OhRKsTGRMd0iYAeiE6oCNEhakspQxZk5ZIH58pnx/YL0iGddB1Ogspb3a0fgI/B1+nYDaQOfXdZ8WDLf//8"
    "9//5TeNff8NgMS682xJg1EBhWtixLBmXl2BAlpAOQdRgrHer53wE1fsSuZL+p3/z3U984l4gqRaLUe0/HD62dm6lFaH2WdctF+0V"
    "9xKVKYcpa5AL8ttgBgYNFxVDkFYZdr1LtolbazFLS3EF3q0zoYqKXRo1YoMxgiXqKKLk0+hHT/z7ffL0+tv96WY6jT7+6dA80UGS"
    "r1OM2ihUpRLsmvJTAh0SkK/RieCIAhjIihdSR7d5j0Qc18AsvwGrOxMdJ/kSiXaoDOqlLMo7tOMS9XIW5/HcQ8kr3c3ipqE3k7w7"
    "h9vIOigXJfSOTig57ux/bfWeDvNXhL17e9Df2dvf7u/1d7cPdGtd1o3uZNEn1PEXMrzQwXNsWKRR+8fBw2Hw4Gf+zGdBFs18Fs78"
    "nVulcgUs/nvesc+moi5Wx7zEecfOPBLfDIr0P7jkpHg="
)
"""One of [1.5, -2] in bfloat16, the same way."""


def test_what_torch_has_pickled_is_read() -> None:
    """Its tensors are views of one storage; their numbers and the steps' arrive."""
    steps = timed_actions(zlib.decompress(base64.b64decode(GOLDEN)))
    assert [step.timestep for step in steps] == [7, 8, 9]
    np.testing.assert_array_equal([step.action for step in steps], [[0, 1], [2, 3], [4, 5]])
    assert steps[0].action.dtype == np.float32


@pytest.mark.parametrize("kind", ["<f4", "<f8", "<f2"])
def test_tensors_of_each_kind_of_number_are_read(kind: str) -> None:
    """Single, double and half."""
    steps = timed_actions(pickled(ROWS.astype(kind), 5))
    np.testing.assert_array_equal([step.action for step in steps], ROWS)
    assert steps[2].timestep == 7 and steps[2].action.dtype.str == kind


def test_a_brain_float_becomes_a_float() -> None:
    """Its two bytes are the upper half of one."""
    (step,) = timed_actions(zlib.decompress(base64.b64decode(BRAIN)))
    np.testing.assert_array_equal(step.action, np.float32([1.5, -2.0]))


class _Runs:
    """Would make a file when it is loaded."""

    def __init__(self, path: Any) -> None:
        self._path = path

    def __reduce__(self) -> Any:
        return os.mkdir, (str(self._path),)


@pytest.mark.parametrize("protocol", [0, 1, 2, 3, 4, 5])
def test_a_hostile_pickle_runs_nothing_and_is_refused_by_name(tmp_path, protocol: int) -> None:
    """Of any protocol, alone or deep inside; loaded by pickle it would run."""
    for what in (_Runs(tmp_path / "a"), [_Runs(tmp_path / "a")], {"timestep": _Runs(tmp_path / "a")}):
        with pytest.raises(Rejected) as caught:
            timed_actions(pickle.dumps(what, protocol))
        assert caught.value.code is Code.BAD_REQUEST and caught.value.field == "server" and caught.value.hint
        assert protocol < 2 or "posix.mkdir" in caught.value.message
    assert not list(tmp_path.iterdir())
    pickle.loads(pickle.dumps(_Runs(tmp_path / "a"), protocol))
    assert list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "hostile",
    [
        b"cbuiltins\neval\n(S'1'\ntR.",
        b"\x80\x04\x8c\x08builtins\x8c\x04exec\x93\x8c\x011\x85R.",
        b"(S'id'\nios\nsystem\n.",
        b"S'\\S'\n.",  # an escape that Python warns of
        b"ctorch\n\\Storage\n.",
        b"\x80\x02\x82\x01.",  # a class of copyreg's registry
        b"\x80\x04ctorch._utils\n_rebuild_tensor_v2\n}\x8c\x08__code__Nsb.",  # state for a function
        b"ccollections\nOrderedDict\n\x8c\x08__init__N\x86b.",
        b"\x80\x04Nr\xff\xff\xff\x7f.",  # place 2147483647 of the memo
        b"\x80\x04\x8d\xff\xff\xff\xff\xff\xff\xff\x7fx.",  # a text of 2^63 bytes
        b"\x80\x04" + b"(" * 1000 + b".",
        b"\x80\x04]" + b"\x85" * 5000 + b"N\x86\x81.",
        b"\x80\x04}]" + b"\x85" * 5000 + b"Ns.",  # a key to be hashed as deep
        b"\x80\x04" + b"]" * 200_000 + b".",
        b"\x80\x04]" + b"2" * 10 + b".",
        b"\x80\x04]\x94h\x00a.",  # a list that holds itself
        b"e.",
        b"",
        b".",
        b"\x80\x04N",
        b"\x80\x04\x8c\x02\xff\xff.",
        b"not a pickle at all",
        pickle.dumps({}),
        pickle.dumps([1]),
        pickle.dumps([{"timestep": 1}]),
    ],
)
def test_what_is_no_list_of_actions_is_refused(hostile: bytes) -> None:
    """Whatever a server sends is an error that names the server; nothing else comes of it."""
    with pytest.raises(Rejected) as caught:
        timed_actions(hostile)
    assert caught.value.code is Code.BAD_REQUEST and caught.value.message.startswith("the policy server sent")


@pytest.mark.parametrize(
    ("wrong", "code"),
    [
        ({"size": (5,), "off": 8}, Code.WRONG_SHAPE),
        ({"off": -1}, Code.WRONG_SHAPE),
        ({"stride": (0,)}, Code.WRONG_SHAPE),
        ({"stride": (-1,), "off": 3}, Code.WRONG_SHAPE),
        ({"stride": (10**30,)}, Code.WRONG_SHAPE),
        ({"size": (-4,)}, Code.WRONG_SHAPE),
        ({"size": (0,)}, Code.WRONG_SHAPE),
        ({"size": (2, 2), "stride": (2, 1)}, Code.WRONG_SHAPE),
        ({"size": ()}, Code.WRONG_SHAPE),
        ({"size": "four"}, Code.WRONG_SHAPE),
        ({"count": 13}, Code.BAD_REQUEST),
        ({"numel": 2**70}, Code.BAD_REQUEST),
        ({"numel": -(2**70)}, Code.BAD_REQUEST),
        ({"little_endian": False}, Code.BAD_REQUEST),
    ],
)
def test_a_tensor_that_does_not_fit_its_data_is_refused(wrong: dict[str, Any], code: Code) -> None:
    """Nothing is read beyond what was sent."""
    with pytest.raises(Rejected) as caught:
        timed_actions(pickled(ROWS, **wrong))
    assert caught.value.code is code


def test_a_tensor_of_other_things_than_real_numbers_is_refused() -> None:
    """By the name of its storage."""
    with pytest.raises(Rejected, match=r"torch\.LongStorage"):
        timed_actions(pickled(ROWS.astype("<i8")))


@given(st.integers(0, 2000), st.binary(max_size=8))
def test_a_torn_or_changed_answer_is_refused_or_is_one(at: int, instead: bytes) -> None:
    """At whatever place: never another exception."""
    data = pickled(ROWS)
    try:
        timed_actions(data[: at % len(data)] + instead + data[at % len(data) + len(instead) :])
    except GatewayError as error:
        assert error.field == "server"


@given(st.binary(max_size=200))
def test_any_bytes_are_refused_or_are_a_list(data: bytes) -> None:
    """The same of noise."""
    try:
        assert timed_actions(data) == []
    except GatewayError as error:
        assert error.field == "server"


def test_what_is_sent_becomes_lerobots_own_classes() -> None:
    """Loaded as its server loads it: fields, numbers and arrays are there."""
    picture = np.arange(24, dtype=np.uint8).reshape(2, 4, 3)
    seen = {"timestamp": 1.5, "timestep": 3, "observation": {"head": picture, "task": "折"}, "must_go": True}
    found = loaded(as_stock("TimedObservation", seen))
    assert type(found).__name__ == "TimedObservation" and found.timestep == 3 and found.must_go is True
    np.testing.assert_array_equal(found.observation["head"], picture)
    assert found.observation["task"] == "折"
