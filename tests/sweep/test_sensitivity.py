"""What the study of the paper's Section 6.2 makes of its sweeps, on made results: nothing is solved here."""

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest

from benchmarks import paper
from benchmarks.sensitivity import __main__ as command
from benchmarks.sensitivity import bench, cantilever, clamps, guesses
from scan2flex_jax import plot
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.sweep import Axis, Calls, Output, draws, sweep
from scan2flex_jax.sweep.task import NOT_RUN

mpl.use("Agg")


def drawn(error, count):
    """Lanes whose estimates are off by ``error(turns)``, a logarithm, with intervals of ten per cent."""
    turns = np.random.default_rng(0).normal(size=(count, 3, 2, 3))
    names = [name + bar for name in paper.STIFF for bar in ("", "_low", "_high")]

    def estimate(lane):
        off = np.exp(error(lane["tilt"]))
        values = {name: value * off for name, value in paper.TRUTH.items()}
        return values | {f"{n}_low": 0.9 * x for n, x in values.items()} | {f"{n}_high": 1.1 * x for n, x in values.items()}

    return sweep(Calls(estimate, dict.fromkeys(names, Output("N m^2"))), draws(tilt=Axis(turns, "rad")))


def test_errors_of_turned_clamps_and_where_they_come_from():
    told = clamps.errors(drawn(lambda turns: 0.01 * turns.sum(), 200))
    EI = told["bending_stiffness"]
    assert told["draws"] == 200 and told["failed"] == 0
    assert EI["linear in the turns"] == pytest.approx(1.0, abs=1e-9)
    assert EI["spread"] == pytest.approx(0.01 * np.sqrt(18), rel=0.1) and abs(EI["in standard errors"]) < 3
    second = clamps.errors(drawn(lambda turns: -0.01 * (turns**2).sum(), 200))
    assert second["both underestimated"] == 1.0 and second["bending_stiffness"]["linear in the turns"] < 0.2
    assert second["bending_stiffness"]["mean"] == pytest.approx(-0.18, rel=0.05)
    assert "linear in the turns" not in clamps.errors(drawn(lambda turns: 0.01 * turns.sum(), 20))["bending_stiffness"]


def test_lanes_that_were_not_run_do_not_count():
    def estimate(lane):
        EI = paper.EI * (1.0 if lane["guess_bending_stiffness"] < 1.0 else 1.01)
        return {"bending_stiffness": EI, "torsional_stiffness": paper.GJ, "cost": 0.0}

    outputs = dict.fromkeys(("bending_stiffness", "torsional_stiffness", "cost"), Output())
    told = guesses.outcomes(sweep(Calls(estimate, outputs), guesses.lanes(5)))
    assert (told["guesses"], told["run"], told["recovered"]) == (25, 25, 10)
    none = sweep(Calls(estimate, outputs), guesses.lanes(5), longest=-1.0)
    assert not bench.run(none).any()


def test_basins_show_ends_and_failures_and_nothing_where_no_fit_was_run():
    def estimate(lane):
        EI, GJ = lane["guess_bending_stiffness"], lane["guess_torsional_stiffness"]
        if EI > 1.0 and GJ > 1.0:
            raise Scan2FlexError("no equilibrium")
        right = EI < 1.0
        return {"bending_stiffness": 0.1 if right else 0.2, "torsional_stiffness": paper.GJ, "cost": float(not right)}

    outputs = dict.fromkeys(("bending_stiffness", "torsional_stiffness", "cost"), Output())
    found = sweep(Calls(estimate, outputs), guesses.lanes(5))
    found["code"][0, 0] = NOT_RUN
    for name in outputs:
        found[name][0, 0] = np.nan
    ax = plot.basins(found)
    crosses = ax.lines[0].get_xydata()
    assert len(crosses) == 4 and np.all(crosses > 1.0)
    ends = [text.get_text() for text in ax.get_legend().get_texts()]
    assert ends == ["0.1, 0.25 (9)", "0.2, 0.25 (11)"]
    plt.close("all")


def test_error_of_a_stiff_cantilever_is_the_formula():
    u = cantilever.W * paper.LENGTH**4 / (8 * cantilever.VALUES)
    told = cantilever.errors(u, -u)
    np.testing.assert_allclose(told["relative error of EI"], told["formula 8 EI du/(w L^4)"], rtol=1e-12)
    assert told["power of EI/(g rhoA), stiff half"] == pytest.approx(1.0)
    for d in told["of draws"]:  # where the error is small, reading back is linear
        k = int(np.argmin(np.abs(np.array(told["EI/(g rhoA) (m^3)"]) - d["EI/(g rhoA) (m^3)"])))
        if told["relative error of EI"][k] < 0.02:
            assert d["relative error of EI"] == pytest.approx(told["relative error of EI"][k], rel=0.1)


def test_figures_are_kept_beside_those_of_other_parts(tmp_path, monkeypatch):
    monkeypatch.setattr("benchmarks.record.RESULTS", tmp_path)
    monkeypatch.setattr(bench, "RESULTS", tmp_path)
    bench.Bench(1.0).keep("guesses", "5 x 5, least-squares", {"median equilibria": 20.0})
    later = bench.Bench(1.0)
    later.keep("guesses", "5 x 5, bfgs", {"median equilibria": 200.0})
    assert list(later.results["guesses"]) == ["5 x 5, least-squares", "5 x 5, bfgs"]
    assert later.results["guesses"]["5 x 5, bfgs"]["by"].startswith("0.")
    assert list(command.ratios(later.results).values()) == [0.1]
