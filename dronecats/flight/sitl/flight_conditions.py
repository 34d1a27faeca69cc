"""What a simulated vehicle is flown in: the air, and how much worse than their own its sensors are."""

from dataclasses import dataclass

from foundation.frames import Vec3


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightConditions:
    """The same for all vehicles of a simulation. The defaults are those of the benchmark."""

    wind_ned: Vec3 = (0.0, 0.0, 0.0)  # m/s, the direction the air moves to
    gusts_w20: float = 0.0  # m/s, the wind at 20 ft that the turbulence belongs to
    gps_delay_s: float = 0.0  # s by which fixes are older than they say
    gps_noise: float = 1.0  # × the errors of a fix
    sensor_noise: float = 1.0  # × noise and drift of accelerometer, gyroscope, compass and barometer


AS_EVER = FlightConditions()
