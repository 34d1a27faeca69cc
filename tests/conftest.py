import gc
import signal

from hypothesis import settings

# A shell that starts us in the background has SIGINT ignored, and every child would inherit that: no Ctrl-C to test.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# How long an example takes is the machine's matter, and no test's.
settings.register_profile("unhurried", deadline=None)
settings.load_profile("unhurried")


def pytest_collection_finish(session):
    """Thousands of collected tests stay to the end: no collection has to look at them again, which would take a second.

    In that second nothing that a test runs in real time goes on, such as the wire between an agent and a vehicle.
    """
    gc.collect()
    gc.freeze()
