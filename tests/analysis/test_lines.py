"""Lines and bands: panels, axes that end close above low curves, small multiples, and looks of methods."""

from dataclasses import replace

import numpy as np
import pytest
from plots import lines
from synthetic import LONG, NINE, uneven

from curiobench.analysis.colours import COLOURS, OUTSIDE, line_styles
from curiobench.analysis.figures import draw_learned, draw_success
from curiobench.analysis.statistics import curve_interval
from curiobench.analysis.style import theme


def seen_ticks(axes):
    """Numbers on the y axis; locators give some beyond its ends, too."""
    low, high = axes.get_ylim()
    return [tick for tick in axes.get_yticks() if low <= tick <= high]


def test_a_panel_for_each_layer_that_the_task_has(drawn):
    (two,) = drawn(draw_success)
    assert [axes.get_title("left") for axes in two.axes] == [
        "A  all goals (4)",
        "B  one layer (2)",
        "C  two layers (2)",
    ]
    (three,) = drawn(draw_success, tasks=["stack3"], seeds=1, suffix="-three")
    assert [axes.get_title("left")[3:] for axes in three.axes] == [
        *("all goals (35)", "one layer (8)", "two layers (21)", "three layers (6)")
    ]


def test_lines_are_means_and_bands_are_bootstrap_intervals(samples):
    task = samples(success=uneven)
    with theme():
        axes = draw_success(task, task.samples)[0].axes[0]
    for sample, band in zip(task.samples, axes.collections, strict=True):
        line = lines(axes)[sample.method]
        assert line.get_xdata().tolist() == [0, 1, 2, 3, 4]
        assert line.get_ydata() == pytest.approx(sample.success[..., 0].mean(0))
        low, high = curve_interval(sample.success[..., 0])
        corners = band.get_paths()[0].vertices
        for x in range(5):
            assert corners[corners[:, 0] == x, 1].min() == pytest.approx(low[x])
            assert corners[corners[:, 0] == x, 1].max() == pytest.approx(high[x])


@pytest.mark.parametrize(("level", "top"), [(0.08, 0.1), (0.12, 0.2), (0.36, 0.4), (0.4, 1), (1, 1)])
def test_low_curves_have_axes_that_end_close_above_them_the_same_in_all_panels(drawn, level, top):
    (figure,) = drawn(draw_success, seeds=1, success=lambda task, method, seed, epoch, goal: level * (goal > 1))
    assert [axes.get_ylim()[1] for axes in figure.axes] == pytest.approx([1.04 * top] * 3)
    assert all(seen_ticks(axes)[-1] == pytest.approx(top) for axes in figure.axes)


def test_axes_of_one_seed_without_a_learned_goal(samples):
    task = samples(seeds=1, epochs=40, success=lambda *args: 0)
    with theme():
        (figure,), (unsteady,) = (draw_learned(t, t.samples) for t in (task, replace(task, steps_per_epoch=None)))
    (axes,) = figure.axes
    assert seen_ticks(axes) == [0, 1, 2]  # integers
    assert len(axes.lines) == 2
    assert not axes.collections  # a single seed has no band
    assert axes.get_xlabel() == "epoch (million steps)"
    assert axes.xaxis.get_major_formatter()(20) == "20\n(0.02)"
    assert unsteady.axes[0].get_xlabel() == "epoch"


def test_many_methods_are_small_multiples_with_sac_in_each(drawn):
    (figure,) = drawn(draw_success, methods=NINE, seeds=2)
    panels = np.reshape(figure.axes, (5, 3))
    assert [axes.get_ylabel() for axes in panels[:, 0]] == ["icm", "rnd", "dac", "re3", "mi"]
    assert [list(lines(axes)) for axes in panels[:, 1]] == [
        *(["sac", "icm", "icm+hm"], ["sac", "rnd", "rnd+hm"], ["sac", "dac"], ["sac", "re3"], ["sac", "mihm", "mi"])
    ]
    assert all(len(axes.lines) == 9 for axes in figure.axes)
    assert {text.get_text() for text in figure.legends[0].get_texts()} == {*NINE, "all others"}


def test_many_variants_of_one_method_take_several_pages(samples):
    task = samples(seeds=1, methods=("icm",))
    many = [replace(task.samples[0], variant=f"sac.tau={i}") for i in range(9)]
    with theme():
        pages = draw_success(task, many)
    names = [axes.get_ylabel() for page in pages for axes in page.axes[::3]]
    assert len(pages) == 2
    assert [name.replace("\n", " ") for name in names] == [f"icm, sac.tau={i}" for i in range(9)]


def test_a_method_looks_the_same_in_every_figure(drawn):
    few = lines(drawn(draw_success, methods=("sac", "icm+hm", LONG), seeds=2)[0].axes[0])
    many = drawn(draw_success, methods=(*NINE, LONG), seeds=2, suffix="-again")[0]
    all_lines = {name: line for axes in many.axes for name, line in lines(axes).items()}
    assert set(few) == {"sac", "icm+hm", "SomethingLong+hm"}
    for name, line in few.items():
        for look in ("color", "linestyle", "marker", "markerfacecolor"):
            assert getattr(line, f"get_{look}")() == getattr(all_lines[name], f"get_{look}")()
    assert all_lines["icm"].get_linestyle() == "--"
    assert all_lines["icm"].get_color() == all_lines["icm+hm"].get_color()


def test_every_method_from_outside_has_a_colour_of_its_own_that_stays(samples):
    names = [f"lab:Class{i}" for i in range(len(OUTSIDE))]
    colours = {sample.method: sample.look["color"] for sample in samples(methods=["sac", *names]).samples}
    assert len(set(colours.values())) == len(names) + 1
    assert not {colours[name] for name in names} & set(COLOURS.values())
    alone = [line_styles([name])[name]["color"] for name in names]
    assert len(set(alone)) > 1
    assert line_styles([names[0], "icm"])[names[0]]["color"] == alone[0]
    assert line_styles(["lab:Class0+hm", names[0]])["lab:Class0+hm"]["color"] == alone[0]
    assert len(line_styles([*names, "lab:OneMore"])) == len(names) + 1
