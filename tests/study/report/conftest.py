"""A report of a small study, written once, and a browser without a network."""

import pytest

from dronecats.cli.main import main
from dronecats.report import figures as style
from tests.report.conftest import reader as reader
from tests.study.studies import APPROACHING, TRACKING, write_study


@pytest.fixture(scope="session")
def study_folder(tmp_path_factory):
    """The folder of a study of two factors and two pilots."""
    out = tmp_path_factory.mktemp("studies") / "slow-and-windy"
    write_study(
        out,
        {"latency": (0.0, 1.0, 2.0), "wind": (0.0, 8.0)},
        lambda pilot, levels: 2.0 - 1.5 * float(levels["latency"]) - 0.1 * float(levels["wind"]),
        pilots=("vision", "oracle"),
        episodes=(*TRACKING[:3], *APPROACHING[:2]),
        same_draws=False,  # else each episode changes its outcome only once, and effects are not finite
    )
    return out


@pytest.fixture(scope="session")
def report(study_folder, tmp_path_factory):
    """The report of that study."""
    out = tmp_path_factory.mktemp("reports") / "report"
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(style.SETTINGS, "savefig.dpi", 50)  # drawing time grows with the pixels
        assert main(["study", "report", str(study_folder), "--out", str(out)]) == 0
    return out
