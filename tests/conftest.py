import gc
import os
import signal
from collections import Counter

# Set before any import of numpy. On busy cores, OpenBLAS's threads spend ten times the work waiting for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest
from hypothesis import settings

from tests import natures

pytest_plugins = ["tests.support.browser", "tests.support.flown_runs"]

# A shell ignores SIGINT in background jobs, and child processes inherit that. Tests of Ctrl-C need the default handler.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# No deadline: the duration of an example depends on the machine.
settings.register_profile("unhurried", deadline=None)
settings.load_profile("unhurried")

LONG_S = 30.0  # a longer test must give a reason as the argument of its mark `slow`

# The slow files that take longest begin first. Otherwise one worker would run one of them while the others are done.
LONGEST = (
    "tests/bench/test_cluster.py",
    "tests/system/test_realtime.py",
    "tests/system/test_wheel.py",
    "tests/benchmarks/test_short_forms.py",
    "tests/system/test_connected.py",
    "tests/system/test_courses.py",
)

guard = natures.Guard()


def pytest_configure(config):
    for nature, needs in natures.NATURES.items():
        config.addinivalue_line("markers", f"{nature}: {needs}")


def pytest_ignore_collect(collection_path, config):
    """Skip files without unit tests when only unit tests are selected, because importing them takes ten seconds."""
    if config.getoption("markexpr") == "unit" and collection_path.suffix == ".py":
        return natures.of_path(collection_path.relative_to(config.rootpath).as_posix()) != "unit" or None
    return None


def pytest_itemcollected(item):
    natures.mark(item)
    if slow := item.get_closest_marker("slow"):
        item.user_properties.append(("reason", " ".join(slow.args)))
        if item.get_closest_marker("xdist_group") is None:  # one worker runs the file: its tests share flights
            item.add_marker(pytest.mark.xdist_group(item.nodeid.partition("::")[0]))


def pytest_collection_modifyitems(items):
    places = {file: place for place, file in enumerate(LONGEST)}
    items.sort(key=lambda item: places.get(item.location[0], len(LONGEST)))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item):
    guard.watch_engines()
    guard.item = item
    try:
        return (yield)
    finally:
        guard.item = None


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item):
    guard.item = item
    try:
        return (yield)
    finally:
        guard.item = None


def pytest_terminal_summary(terminalreporter):
    """List the reasons of skipped tests, and the long tests that give no reason for their duration."""
    reasons = Counter(report.longrepr[2] for report in terminalreporter.getreports("skipped"))
    if reasons:
        terminalreporter.section("skipped tests")
    for reason, count in reasons.most_common():
        terminalreporter.write_line(f"{count:4} {reason.removeprefix('Skipped: ')}")
    long = [
        report
        for report in terminalreporter.getreports("passed")
        if report.when == "call" and report.duration > LONG_S and not dict(report.user_properties).get("reason")
    ]
    if long:
        terminalreporter.section(f"over {LONG_S:.0f} s without a reason, as in pytest.mark.slow('flies for a minute')")
    for report in long:
        terminalreporter.write_line(f"{report.duration:5.0f} s {report.nodeid}")


def pytest_collection_finish(session):
    """Exclude the collected tests from garbage collection.

    A scan of their thousands of objects takes a second. It would stall real-time tests, such as those of the link
    between an agent and a vehicle.
    """
    gc.collect()
    gc.freeze()
