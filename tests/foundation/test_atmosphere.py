"""Pressure and altitude against tables of the International Standard Atmosphere (ISO 2533)."""

import pytest

from foundation.atmosphere import pressure, pressure_altitude


@pytest.mark.parametrize(("altitude_m", "hpa"), [(0.0, 1013.25), (500.0, 954.61), (1000.0, 898.746), (3000.0, 701.08)])
def test_pressure_and_altitude_match_the_standard_tables(altitude_m: float, hpa: float) -> None:
    assert pressure(altitude_m) == pytest.approx(hpa, abs=0.05)
    assert pressure_altitude(hpa) == pytest.approx(altitude_m, abs=0.5)


def test_pressure_altitude_inverts_pressure() -> None:
    assert pressure_altitude(pressure(1200.0)) == pytest.approx(1200.0, abs=0.05)
