"""The example for MAVSDK 3, which needs its own environment: `--mavsdk3 PYTHON`."""

import pytest

from tests.support.mavsdk_example import fly_example
from tests.support.simulated_vehicle import patient_state, simulated_vehicle

SPEED = 4.0


@pytest.mark.slow
def test_a_mavsdk_3_script_takes_off_flies_offboard_and_lands(tmp_path, pytestconfig):
    python = pytestconfig.getoption("--mavsdk3", None)
    if python is None:
        pytest.skip('no mavsdk 3; to enable: --mavsdk3 PYTHON (of an environment with "mavsdk<4")')
    with simulated_vehicle(tmp_path, SPEED, patient_state(tmp_path)) as ports:
        fly_example("mavsdk3.py", python.absolute(), f"udpout://127.0.0.1:{ports['agent'][0]}")
