"""The vehicle always gets the order to land, even if something else fails at the end of a flight."""

import signal
from types import SimpleNamespace

import pytest

from dronecats.cli.exit_status import interrupt_on_signals
from dronecats.flight.run.ascent import StartOffset, ascend
from dronecats.flight.run.landing import finish, signals_handled, unexpected
from dronecats.flight.run.progress import SafetyLog
from foundation.errors import CameraError, InfrastructureError, LinkError
from foundation.mavlink import dialect
from hil.link.envelope import Limits
from hil.link.link import Link
from tests.hil.link.scripted_vehicle import ScriptedVehicle, flying


class Landing(ScriptedVehicle):
    """Counts as landed right after the order to land, so that tests do not wait."""

    def step(self):
        self.armed = self.armed and self.mode != "LAND"
        super().step()


@pytest.fixture
def vehicle():
    return Landing()


def stage(*links, cause=lambda error: error, check_vehicles=lambda: None, end=lambda reason, error: None):
    return SimpleNamespace(links=links, end=end, cause=cause, check_vehicles=check_vehicles)


def test_a_closed_terminal_does_not_prevent_the_landing(vehicle):
    link = flying(vehicle)

    def say(line):
        raise BrokenPipeError(32, "Broken pipe")

    finish(stage(link), "error", None, "land", say)
    assert vehicle.mode == "LAND"


def test_a_full_disk_does_not_prevent_the_landing(vehicle, tmp_path):
    link = flying(vehicle, limits=Limits(ceiling_m=3.0, margin_m=0.5))
    SafetyLog(tmp_path / "no such folder" / "safety.jsonl", [link], lambda line: None)
    vehicle.position[2] = -4.0  # 4 m high, above the ceiling: the envelope acts when the vehicle stops
    finish(stage(link), "error", None, "land", lambda line: None)
    assert vehicle.mode == "LAND"


def test_a_hanging_process_is_the_error_in_the_result_and_in_the_log(vehicle):
    ended: list[str | None] = []
    hangs = InfrastructureError("the camera process hangs: no answer for 10 s; see camera.log")
    on = stage(flying(vehicle), cause=lambda error: hangs, end=lambda reason, error: ended.append(error))
    assert finish(on, "error", CameraError("no frame"), "land", lambda line: None) is hangs
    assert ended == [str(hangs)]
    assert vehicle.mode == "LAND"


def test_the_links_of_other_drones_are_served_while_one_drone_lands(vehicle, monkeypatch):
    first, second = flying(vehicle), flying(Landing())
    kept = []
    monkeypatch.setattr(second, "keep_up", lambda: kept.append(vehicle.mode))
    finish(stage(first, second), "cap", None, "land", lambda line: None)
    assert "OFFBOARD" in kept
    assert vehicle.mode == "LAND"


@pytest.mark.parametrize("reason", ["takeover", "budget"])
def test_takeovers_and_spent_budgets_keep_their_own_error(vehicle, reason):
    error = LinkError("somebody else flies it")
    on = stage(flying(vehicle), cause=lambda error: InfrastructureError("the camera process hangs"))
    assert finish(on, reason, error, "land", lambda line: None) is error


def test_the_landing_does_not_wait_for_vehicles_of_a_hanging_simulator(vehicle):
    def gone():
        raise InfrastructureError("the simulator process hangs")

    fleet = [flying(vehicle), flying(Landing())]
    for link in fleet:
        link.transport = ScriptedVehicle().transport()
        link.transport.receive = lambda timeout_s: b""
    notices: list[str] = []
    finish(stage(*fleet, check_vehicles=gone), "error", LinkError("it has been silent"), "land", notices.append)
    assert len([line for line in notices if "the simulator process hangs" in line]) == 2


def test_the_notice_of_an_unfinished_landing_names_the_drone_and_the_effect(vehicle):
    stays_armed = ScriptedVehicle()
    events: list[str] = []
    ended = stage(flying(vehicle), flying(stays_armed), end=lambda reason, error: events.append("the log is complete"))
    assert finish(ended, "decided", None, "land", events.append) is None  # it is not an error of the flight
    complete, (line,) = events.index("the log is complete"), [line for line in events if "end of the landing" in line]
    assert complete < events.index(line)
    for words in ("drone 2", "score is not affected", "may still be armed"):
        assert words in line
    alone: list[str] = []
    finish(stage(flying(ScriptedVehicle())), "decided", None, "land", alone.append)
    assert [line for line in alone if "end of the landing" in line and "drone" not in line]


def test_a_failed_landing_does_not_affect_the_score(vehicle):
    def gone():
        raise LinkError("the cable is out")

    notices: list[str] = []
    finish(stage(flying(vehicle), check_vehicles=gone), "decided", None, "land", notices.append)
    assert [line for line in notices if "cable is out" in line and "score is not affected" in line]


def test_an_unexpected_error_becomes_a_sentence_even_on_a_full_disk(tmp_path):
    failure = unexpected(OSError(28, "No space left on device"), tmp_path / "no such folder")
    assert "No space left" in str(failure)
    assert "ZeroDivisionError" in str(unexpected(ZeroDivisionError("division"), tmp_path / "no such folder"))


def test_an_unexpected_error_of_one_link_does_not_prevent_landing_the_next_vehicle(vehicle):
    other = flying(ScriptedVehicle())

    def broken(message):
        raise RuntimeError("what nobody expects")

    other.send = broken
    finish(stage(other, flying(vehicle)), "error", None, "land", lambda line: None)
    assert vehicle.mode == "LAND"


@pytest.mark.parametrize("after_ms", [0, 200, 480])
def test_a_second_interrupt_waits_until_the_landing_is_ordered(vehicle, after_ms):
    link = flying(vehicle)
    notices: list[str] = []
    pressed: list[bool] = []
    due_ms, go_on = vehicle.time_ms + after_ms, vehicle.take

    def take():
        if vehicle.time_ms >= due_ms and not pressed:
            pressed.append(True)
            signal.raise_signal(signal.SIGINT)
        return go_on()

    vehicle.take = take
    link.transport = vehicle.transport()
    finish(stage(link), "interrupted", None, "land", notices.append)
    assert vehicle.mode == "LAND"
    assert any("waiting" in line for line in notices)


@pytest.mark.parametrize(("armed", "landed"), [(True, True), (True, False), (False, False)])
def test_a_vehicle_that_is_armed_or_in_the_air_is_rejected(vehicle, armed, landed):
    vehicle.armed, vehicle.landed, vehicle.mode = armed, landed, "POSCTL"
    with pytest.raises(LinkError, match="--arm"):
        ascend([Link(vehicle.transport())], [StartOffset((0.0, 0.0, -2.5), None)], lambda line: None)
    assert {c[0] for c in vehicle.commands} <= {511, 512}
    assert vehicle.mode == "POSCTL"


def test_a_vehicle_with_a_low_battery_is_not_armed(vehicle):
    vehicle.armed, vehicle.landed, vehicle.battery = False, True, 10
    with pytest.raises(LinkError, match="10%"):
        ascend([Link(vehicle.transport(), limits=Limits())], [StartOffset((0.0, 0.0, -2.5), None)], lambda line: None)
    assert dialect.MAV_CMD_COMPONENT_ARM_DISARM not in {c[0] for c in vehicle.commands}


SINKS = "COM_OBL_RC_ACT = 0 (Position)"


@pytest.mark.parametrize("ending", ["disarmed", "unreachable", "landed", "taken"])
def test_the_failsafe_behaviour_is_reported_for_disarmed_and_unreachable_vehicles(vehicle, ending):
    link = flying(vehicle)
    link.failsafe = SINKS
    notices: list[str] = []
    if ending == "disarmed":  # according to a heartbeat, which may be wrong
        vehicle.armed = False
    if ending == "taken":
        vehicle.mode = "POSCTL"
    if ending in ("disarmed", "taken"):
        with pytest.raises(LinkError):
            link.wait(5.0)
    if ending == "unreachable":
        vehicle.command = lambda message: None
    finish(stage(link), "error", None, "land", notices.append)
    assert any(SINKS in line for line in notices) == (ending in ("disarmed", "unreachable"))


def test_a_notice_of_the_link_reaches_the_user(vehicle, tmp_path):
    link = flying(vehicle)
    notices: list[str] = []
    SafetyLog(tmp_path / "safety.jsonl", [link], notices.append)
    link.on_notice("an address sends messages")
    assert "an address sends messages" in notices[0]


def test_a_signal_that_nohup_ignores_stays_ignored():
    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP)}
    try:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        interrupt_on_signals()
        with signals_handled(lambda number, frame: None):
            assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
        assert signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
