"""What is said when an import fails: another sentence for each fault, and none for a mistake of our own."""

import pytest

from dronecats.cli import main as command_line
from dronecats.rundir.folder import missing_package


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (ModuleNotFoundError("No module named 'numba'", name="numba"), "pip install 'dronecats[sim]'"),
        (ModuleNotFoundError("No module named 'duckdb'", name="duckdb"), "pip install 'dronecats[query]'"),
        (ModuleNotFoundError("No module named 'cv2.aruco'", name="cv2.aruco"), "cv2.aruco is not installed"),
        (ImportError("libGL.so.1: cannot open", name="cv2"), "cv2 cannot be loaded (libGL.so.1: cannot open)"),
        (ImportError("half a package"), "a package cannot be loaded (half a package)"),
    ],
)
def test_another_package_is_named_with_the_way_to_get_it(error, said):
    assert said in (missing_package(error) or "")


@pytest.mark.parametrize("ours", ["hil.lnik", "foundation.eror"])
def test_a_module_of_our_own_is_a_mistake_of_ours_and_keeps_its_traceback(monkeypatch, ours):
    def broken(args):
        raise ModuleNotFoundError(f"No module named '{ours}'", name=ours)

    monkeypatch.setattr("dronecats.cli.doctor.run", broken)
    with pytest.raises(ModuleNotFoundError, match=ours):
        command_line.main(["doctor"])
