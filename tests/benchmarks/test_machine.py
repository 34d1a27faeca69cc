"""A reference loop makes the figures of two machines comparable."""

from benchmarks import machine


def test_figures_per_reference_loop_do_not_depend_on_the_machine(monkeypatch):
    for slower in (1.0, 3.0):
        monkeypatch.setattr(machine, "python_loop_ms", lambda slower=slower: 20.0 * slower)
        here = machine.Machine()
        assert here.rtf_x_loop(500.0 / slower) == 10_000, slower
        assert here.per_loop(90.0 * slower) == 4.5, slower
        assert here.figures()["python_loop_ms"] == 20.0 * slower, slower
