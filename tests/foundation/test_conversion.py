import subprocess
import sys

import pytest

FIRST_USE_BY_EIGHT_THREADS = """
import sys, threading
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from dronecats.flight.spec.spec_file import as_json, from_json

sys.setswitchinterval(1e-6)
spec = FlightSpec(pilot="oracle", simulated=Simulated())
value, equal, together = as_json(spec), [], threading.Barrier(8)

def read():
    together.wait()
    equal.append(from_json(value, "a test") == spec)

threads = [threading.Thread(target=read) for _ in range(8)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
sys.exit(0 if equal == [True] * 8 else 1)
"""


@pytest.mark.process
def test_threads_may_convert_to_a_class_at_its_first_use():
    """msgspec alone crashes the process here (signal 11)."""
    ended = subprocess.run([sys.executable, "-c", FIRST_USE_BY_EIGHT_THREADS], capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr
