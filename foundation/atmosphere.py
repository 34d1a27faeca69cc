"""The troposphere of the International Standard Atmosphere (ISA, ISO 2533): pressure and altitude below 11 km.

As in `foundation.frames`, the functions take and return plain floats, so that numba can compile them into kernels.
"""

PRESSURE_0 = 1013.25  # hPa, at sea level
TEMPERATURE_0 = 288.15  # K, at sea level
LAPSE = 0.0065  # K/m
EXPONENT = 5.255876  # gravity · molar mass of air / (gas constant · LAPSE)


def pressure(altitude: float) -> float:
    """Return the pressure (hPa) at an altitude (m above mean sea level)."""
    hpa: float = PRESSURE_0 * (1.0 - LAPSE / TEMPERATURE_0 * altitude) ** EXPONENT
    return hpa


def pressure_altitude(pressure_hpa: float) -> float:
    """Return the altitude (m above mean sea level) at a pressure (hPa, above 0)."""
    altitude: float = 44330.769 * (1.0 - (pressure_hpa / PRESSURE_0) ** 0.190263)
    return altitude
