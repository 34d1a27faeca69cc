"""The pack: open-circuit voltage over charge, sag over current, and what the rotors take out of it."""

import numpy as np

from foundation.compiled import Record, njit

NOMINAL_CELL_V = 3.8  # the voltage at which a rotor reaches its `speed_max`: a LiPo cell in mid-discharge
PERIOD_US = 10_000  # the pack is slow; ten steps share one update
EFFICIENCY = 0.7  # electrical to shaft power, motor and speed controller together; usual for hobby power trains

# V per cell at 0, 5, 10, 20 … 100 % charge at rest: the usual shape of a LiPo's discharge curve at low current.
_CHARGE = np.array([0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0])
_VOLTAGE = np.array([3.0, 3.45, 3.62, 3.72, 3.76, 3.79, 3.83, 3.88, 3.94, 4.01, 4.09, 4.2])
COLLAPSE = -0.01  # charge at which the voltage of an over-discharged pack is gone


@njit(cache=True)
def open_circuit(charge: float) -> float:
    """Return the volts of one cell at rest for a charge in [0, 1]; below 0 the cell collapses."""
    volts: float = _VOLTAGE[-1]
    if charge <= 0.0:
        volts = max(_VOLTAGE[0] * (1.0 - charge / COLLAPSE), 0.0)
        return volts
    for i in range(1, len(_CHARGE)):
        if charge <= _CHARGE[i]:
            share = (charge - _CHARGE[i - 1]) / (_CHARGE[i] - _CHARGE[i - 1])
            volts = _VOLTAGE[i - 1] + share * (_VOLTAGE[i] - _VOLTAGE[i - 1])
            break
    return volts


@njit(cache=True)
def drain(params: Record, state: Record) -> None:
    """Take `PERIOD_US` worth of the present power out of the pack; writes charge, voltage and current."""
    rest = params.cells * open_circuit(state.charge_ah / params.capacity_ah)
    power = state.rotor_power / EFFICIENCY + params.avionics_w
    # the last terminal voltage stands in for the present one: at 100 Hz it lags the pack by less than its noise
    current = power / max(state.voltage, 0.5 * rest, 0.1) if rest > 0.0 else 0.0
    state.current = current
    state.voltage = max(rest - current * params.resistance_ohm, 0.0)
    state.charge_ah = max(state.charge_ah - current * PERIOD_US / 3.6e9, params.charge_least_ah)
