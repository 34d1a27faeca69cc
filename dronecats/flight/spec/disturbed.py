"""What is done to a flight on purpose, in words: for run.json, and for whoever reads a report."""

from collections.abc import Iterator

from dronecats.flight.spec.disturbances import Disturbances, FrameFaults, LinkFaults, VehicleFaults
from hil.impairment.channel import Impairment


def disturbed(disturbances: Disturbances) -> str | None:
    """Return what is done, several things joined by commas; None where it is nothing."""
    told = [*_of_pictures(disturbances.frame), *_of_wire(disturbances.link), *_of_vehicle(disturbances.vehicle)]
    return ", ".join(told) or None


def _of_pictures(frame: FrameFaults) -> Iterator[str]:
    if frame.rate_hz is not None:
        yield f"pictures are taken {frame.rate_hz:g} times a second"
    if frame.delay_s:
        yield f"pictures come {frame.delay_s:g} s late"
    if frame.dropped:
        yield f"{100 * frame.dropped:g} % of pictures never come"
    if frame.stale:
        yield f"{100 * frame.stale:g} % of questions have the picture of the question before"


def _of_wire(link: LinkFaults) -> Iterator[str]:
    ways = {"to the vehicle": link.to_vehicle, "from the vehicle": link.from_vehicle}
    if link.to_vehicle == link.from_vehicle:
        ways = {"both ways": link.to_vehicle}
    for way, wire in ways.items():
        if told := " and ".join(_of_way(wire)):
            yield f"the wire {way} has {told}"


def _of_way(wire: Impairment) -> Iterator[str]:
    if wire.delay_s:
        yield f"a delay of {wire.delay_s:g} s"
    if wire.jitter_s:
        yield f"jitter of {wire.jitter_s:g} s"
    for what, share in (("lost", wire.loss), ("doubled", wire.duplicate), ("out of order", wire.reorder)):
        if share:
            yield f"{100 * share:g} % of frames {what}"
    if wire.corrupt:
        yield f"{100 * wire.corrupt:g} % of bytes wrong"
    if wire.baud is not None:
        yield f"{wire.baud} baud and a queue of {wire.queue_bytes} bytes"
    for start, end in wire.cuts:
        yield f"a cut from {start:g} to {end:g} s"


def _of_vehicle(vehicle: VehicleFaults) -> Iterator[str]:
    if any(vehicle.wind_ned):
        north, east, down = vehicle.wind_ned
        yield f"wind of {north:g} m/s north and {east:g} m/s east" + (f" and {down:g} m/s down" if down else "")
    if vehicle.gusts_w20:
        yield f"gusts of a wind of {vehicle.gusts_w20:g} m/s at 20 ft"
    if vehicle.payload_kg:
        yield f"a payload of {vehicle.payload_kg:g} kg"
    if vehicle.gps_delay_s:
        yield f"fixes are {vehicle.gps_delay_s:g} s older than they say"
    for name, factor in (("GPS", vehicle.gps_noise), ("sensor", vehicle.estimator_noise)):
        if factor != 1.0:
            yield f"{name} noise × {factor:g}"
    if vehicle.setpoint_hz is not None:
        yield f"{vehicle.setpoint_hz:g} setpoints a second"
    if vehicle.stalled:
        yield f"the simulator stands still for {vehicle.stall_s:g} s in {100 * vehicle.stalled:g} % of seconds"
