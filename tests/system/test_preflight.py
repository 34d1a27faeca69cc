"""`dronecats preflight` as a user runs it, on our simulator in real time."""

import http.server
import json
import re
import subprocess
import threading

import cv2
import numpy as np
import pytest

from foundation import wire
from foundation.mavlink import dialect
from hil.link.link import Link
from hil.link.transport import Transport, connect
from hil.preflight import ground_side
from hil.preflight.check import rehearse
from tests.support.command_line import DRONECATS
from tests.support.simulated_vehicle import simulated_vehicle

FAILS = {"COM_OBL_RC_ACT = 0", "COM_LOW_BAT_ACT = 0", "GF_MAX_HOR_DIST = 0", "GF_MAX_VER_DIST = 0"}  # PX4's defaults


@pytest.fixture(scope="module")
def vehicle(tmp_path_factory):
    """The URL of a simulated vehicle that is ready to arm."""
    with simulated_vehicle(tmp_path_factory.mktemp("simulator")) as ports:
        url = f"udpout://127.0.0.1:{ports['agent'][0]}"
        link = Link(connect(url))
        link.connect()
        link.wait_for(lambda state: state.healthy, 60.0, "becoming ready to arm")
        link.close()
        yield url


def preflight(*arguments, typed="", folder="."):
    return subprocess.run(
        [*DRONECATS, "preflight", "--seconds", "2", *arguments],
        input=typed, capture_output=True, text=True, timeout=120, check=False, cwd=folder,
    )  # fmt: skip


def failed(report):
    return {row["name"] for row in json.loads(report.stdout)["rows"] if row["passed"] is False}


@pytest.mark.slow
def test_a_new_vehicle_fails_only_for_four_px4_defaults(vehicle, tmp_path):
    report = preflight("--connect", vehicle, "--json", folder=tmp_path)
    assert report.returncode == 1, report.stderr
    assert failed(report) == FAILS
    rows = {row["name"]: row for row in json.loads(report.stdout)["rows"]}
    assert "4.20 V" in rows["battery"]["why"]
    assert rows["offboard rehearsal"]["passed"]
    assert rows["round trip"]["passed"]
    assert rows["clocks"]["passed"]  # the simulator keeps real time
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
@pytest.mark.parametrize("typed", ["", "y\n"])
def test_fix_changes_nothing_without_a_typed_yes(vehicle, typed, tmp_path):
    report = preflight("--connect", vehicle, "--fix", "--json", typed=typed, folder=tmp_path)
    assert report.returncode == 1
    assert re.search(r"0\s+→ 5", report.stderr)
    assert failed(report) == FAILS


def test_a_dead_port_is_a_link_error_and_a_wrong_url_is_a_usage_error(tmp_path):
    assert preflight("--connect", "carrier-pigeon://loft", folder=tmp_path).returncode == 2
    assert preflight("--connect", "tcp://127.0.0.1:1", folder=tmp_path).returncode == 3
    assert preflight("--connect", "udpin://127.0.0.1:0", "--seconds", "0", folder=tmp_path).returncode == 2


class SetpointsLost(Transport):
    """A transport that drops offboard setpoints and passes everything else."""

    def __init__(self, url):
        self._transport = connect(url)
        self.url, self.lost = url, 0

    def receive(self, timeout_s):
        return self._transport.receive(timeout_s)

    def close(self):
        self._transport.close()

    def send(self, data):
        (frame,), _, _ = wire.scan(data)
        if wire.message(frame).get_msgId() == dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED:
            self.lost += 1
        else:
            self._transport.send(data)


@pytest.mark.slow
def test_the_rehearsal_fails_if_setpoints_are_lost(vehicle):
    lossy = SetpointsLost(vehicle)
    link = Link(lossy)
    link.connect()
    row = rehearse(link)
    link.close()
    assert lossy.lost > 30
    assert row.passed is False
    assert row.why


class Snapshot(http.server.BaseHTTPRequestHandler):
    """A camera that gives one picture per request."""

    def do_GET(self):
        picture = cv2.imencode(".jpg", np.zeros((72, 128, 3), np.uint8))[1].tobytes()
        self.send_response(200)
        self.send_header("Content-Type", "image/jpeg")
        self.send_header("Content-Length", str(len(picture)))
        self.end_headers()
        self.wfile.write(picture)

    def log_message(self, *_):
        pass


@pytest.mark.slow
def test_a_working_camera_passes_and_a_missing_one_fails(vehicle, tmp_path):
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Snapshot)
    threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
    url = f"http://127.0.0.1:{server.server_port}/picture.jpg"
    seen = preflight("--connect", vehicle, "--camera", url, "--json", folder=tmp_path)
    camera = next(row for row in json.loads(seen.stdout)["rows"] if row["name"] == "camera")
    server.shutdown()
    server.server_close()
    assert camera["passed"], camera
    assert "128×72" in camera["why"]
    gone = preflight("--connect", vehicle, "--camera", url.replace("//", "//user:secret@"), "--json", folder=tmp_path)
    assert failed(gone) == FAILS | {"camera"}
    assert "secret" not in gone.stdout + gone.stderr


def test_the_disk_check_accepts_a_new_folder_and_rejects_one_below_a_file(tmp_path):
    assert ground_side.disk_row(tmp_path / "runs" / "later").passed
    file = tmp_path / "file"
    file.write_text("")
    assert ground_side.disk_row(file / "runs").passed is False


@pytest.mark.slow
def test_a_typed_yes_applies_all_proposed_changes(vehicle, tmp_path):
    report = preflight("--connect", vehicle, "--fix", typed="yes\n", folder=tmp_path)
    assert report.returncode == 0, report.stdout + report.stderr
    assert "COM_OBL_RC_ACT = 5" in report.stdout
    again = preflight("--connect", vehicle, "--fix", "--json", folder=tmp_path)
    assert again.returncode == 0
    assert failed(again) == set()
    assert json.loads(again.stdout)["changes"] == []
    assert not re.search(r"0\s+→ 5", again.stderr)
