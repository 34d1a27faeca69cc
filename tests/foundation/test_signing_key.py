"""Signing key file: accepted contents, and error messages that do not show the key."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from foundation.errors import UsageError
from foundation.signing import load_key, timestamp

KEY = bytes(range(200, 232))


@pytest.mark.parametrize(
    "data", [KEY, KEY.hex().encode(), KEY.hex().upper().encode() + b"\n", b" " + KEY.hex().encode()]
)
def test_a_key_is_32_bytes_or_64_hexadecimal_digits(tmp_path, data):
    (tmp_path / "key").write_bytes(data)
    assert load_key(tmp_path / "key") == KEY


@pytest.mark.parametrize(
    "data", [b"", b"secret-word", bytes(32), KEY + b"\n", b"0" * 64, b"g" * 64, KEY.hex().encode()[:-1]]
)
def test_other_contents_are_rejected_and_not_shown_in_the_error(tmp_path, data):
    (tmp_path / "key").write_bytes(data)
    with pytest.raises(UsageError, match="64 hexadecimal digits") as refusal:
        load_key(tmp_path / "key")
    assert b"secret" not in str(refusal.value).encode()
    assert KEY.hex()[:8] not in str(refusal.value)
    assert refusal.value.__cause__ is None
    assert refusal.value.__context__ is None


def test_the_error_for_a_missing_file_names_it(tmp_path):
    with pytest.raises(UsageError, match="nothing-here"):
        load_key(tmp_path / "nothing-here")


@given(st.floats(0.0, 4e9))
def test_timestamps_count_from_2015(unix_s):
    assert timestamp(1_420_070_400.0) == 0
    assert timestamp(1_420_070_401.0) == 100_000
    assert 0 <= timestamp(unix_s) < 1 << 48
