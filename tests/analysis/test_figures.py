"""What is in the figures, seen in their Axes, and what `curiobench figure` writes."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.text import Text

from curiobench.analysis.comparison import draw_comparison, draw_heat_map
from curiobench.analysis.figures import (
    FIGURES,
    MOST_POINTS,
    THRESHOLDS,
    draw_bonus,
    draw_exploitation,
    draw_figures,
    draw_learned,
    draw_profile,
    draw_success,
    thinned,
)
from curiobench.analysis.frames import read_results
from curiobench.analysis.samples import task_samples
from curiobench.analysis.statistics import curve_interval
from curiobench.analysis.style import COLOURS, OUTSIDE, line_styles, theme

LONG = "my_lab.curiosity:SomethingLong+hm"
NINE = ("sac", "icm", "rnd", "dac", "re3", "mihm", "icm+hm", "rnd+hm", "mi")


@pytest.fixture
def samples(make_runs):
    """Makes runs of one task, and gives its samples."""

    def make(**options):
        (task,) = task_samples(read_results(make_runs(**options), every_goal=False))
        return task

    return make


@pytest.fixture
def drawn(samples):
    """Makes runs of one task, and gives the pages of a kind of figure of all of them."""

    def make(draw, **options):
        task = samples(**options)
        with theme():
            return draw(task, task.samples)

    return make


def lines(axes):
    """Lines of an Axes by label, grey ones without."""
    return {line.get_label(): line for line in axes.lines if not line.get_label().startswith("_")}


def seen_ticks(axes):
    """Numbers on the y axis; locators give some beyond its ends, too."""
    low, high = axes.get_ylim()
    return [tick for tick in axes.get_yticks() if low <= tick <= high]


def uneven(task, method, seed, epoch, goal):
    """Success of 1 from an epoch on that differs with goal and seed."""
    return float(epoch >= goal + seed + (method == "sac"))


def test_samples_hold_means_of_layers_and_last_success_of_goals(samples):
    task = samples(methods=("mihm", "sac"), seeds=2, success=uneven)
    assert [sample.method for sample in task.samples] == ["sac", "mihm"]
    assert task.sizes == {0: 4, 1: 2, 2: 2}
    mihm = task.samples[1]
    assert mihm.epochs.tolist() == [0, 1, 2, 3, 4]
    assert mihm.success[0, :, 0].tolist() == [0.25, 0.5, 0.75, 1, 1]
    assert mihm.success[1, :, 2].tolist() == [0, 0, 0, 0.5, 1]
    assert mihm.learned[0, :, 1].tolist() == [1, 2, 2, 2, 2]
    assert task.samples[0].goal_success.tolist() == [[1, 1, 1, 1], [1, 1, 1, 0]]
    assert mihm.area[0] == pytest.approx((0.125 + 0.5 + 0.75 + 1 + 0.5) / 4)
    assert task.steps_per_epoch == 1000


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


def test_axes_of_one_seed_without_a_learned_goal(drawn):
    (figure,) = drawn(draw_learned, seeds=1, epochs=40, success=lambda *args: 0)
    (axes,) = figure.axes
    assert seen_ticks(axes) == [0, 1, 2]  # integers
    assert len(axes.lines) == 2
    assert not axes.collections  # a single seed has no band
    assert axes.get_xlabel() == "epoch (million steps)"
    assert axes.xaxis.get_major_formatter()(20) == "20\n(0.02)"


def test_no_steps_where_an_epoch_has_no_fixed_number_of_them(samples):
    task = replace(samples(), steps_per_epoch=None)
    with theme():
        assert draw_learned(task, task.samples)[0].axes[0].get_xlabel() == "epoch"


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


def test_logged_columns_are_drawn_of_methods_that_have_them(samples):
    task = samples(methods=("sac", "icm", "mihm"))
    shown = {name: [s.method for s in task.samples if FIGURES[name].shows(s)] for name in ("exploitation", "bonus")}
    assert shown == {"exploitation": ["mihm"], "bonus": ["icm", "mihm"]}
    _, icm, mihm = task.samples
    with theme():
        (bonus,), (share,) = draw_bonus(task, [icm]), draw_exploitation(task, [mihm])
    assert lines(bonus.axes[0])["icm"].get_ydata() == pytest.approx([0.2, 0.1, 0.2 / 3, 0.05])  # as in synthetic runs
    line = lines(share.axes[0])["mihm"]
    assert line.get_xdata().tolist() == [1, 2, 3, 4]
    assert line.get_ydata() == pytest.approx(0.5 + 0.4 * mihm.success[:, 1:, 0].mean(0))


def test_a_bonus_with_a_spread_above_1_stays_within_its_axes(samples):
    task = samples(methods=("icm",))
    epochs, spread = task.samples[0].logged["bonus_spread"]
    sample = replace(task.samples[0], logged={"bonus_spread": (epochs, 30 * spread)})
    with theme():
        (figure,) = draw_bonus(task, [sample])
    assert figure.axes[0].get_ylim()[1] > 30 * spread.max() > 1


def test_heat_map_has_every_goal_by_layer_and_every_method(samples):
    task = samples(tasks=["stack3"], methods=("sac", LONG), seeds=2)
    with theme():
        (figure,) = draw_heat_map(task, task.samples)
    *blocks, bar = figure.axes
    values = np.concatenate([np.reshape(axes.collections[0].get_array().data, (-1, 2)) for axes in blocks])
    assert values == pytest.approx(100 * np.stack([s.goal_success.mean(0) for s in task.samples], axis=1))
    assert [len(axes.get_yticklabels()) for axes in blocks] == [8, 21, 6]
    assert [t.get_text() for axes in blocks for t in axes.get_yticklabels()] == list(task.goals)
    assert [text.get_text() for text in blocks[0].get_xticklabels()] == ["sac", "SomethingLong+hm"]
    assert bar.get_ylabel() == "final success (%)"
    assert len(blocks[0].texts) == 8 * 2 + 1  # numbers, and the layer's name


def test_a_dollar_in_a_name_is_a_dollar(samples, tmp_path):
    task = samples(seeds=1, methods=("sac",))
    task = replace(task, goals=(r"$\frac{x$", *task.goals[1:]))
    with theme():
        for figure in draw_heat_map(task, task.samples):
            figure.savefig(tmp_path / "map.png")


def test_heat_map_leaves_numbers_out_where_there_is_no_room(drawn):
    names = [f"lab:Class{i}" for i in range(18)]
    (figure,) = drawn(draw_heat_map, methods=names, seeds=1)
    assert [text.get_text() for text in figure.axes[0].texts] == ["one\nlayer"]


def test_profile_is_the_share_of_goals_and_seeds_above_each_threshold(samples):
    task = samples(success=uneven)
    with theme():
        axes = draw_profile(task, task.samples)[0].axes[0]
    sac = task.samples[0].goal_success
    assert lines(axes)["sac"].get_ydata() == pytest.approx([(sac > t).mean() for t in THRESHOLDS])


def test_comparison_shows_means_intervals_and_seeds_in_order(samples):
    task = samples(methods=("mi", "rnd+hm", "sac"), success=uneven)
    with theme():
        (figure,) = draw_comparison(task, task.samples)
    learned, end = figure.axes[0], figure.axes[3]
    assert [text.get_text() for text in learned.get_yticklabels()] == ["sac", "rnd+hm", "mi"]
    sac = task.samples[0].last_learned[:, 0]
    assert learned.lines[0].get_xdata() == pytest.approx([sac.mean()])
    assert learned.lines[1].get_xdata().tolist() == sac.tolist()
    (start, _), (stop, _) = learned.collections[0].get_segments()[0]
    assert (start, stop) == pytest.approx(curve_interval(sac))
    assert end.lines[0].get_xdata() == pytest.approx([task.samples[0].last_success[:, 0].mean()])


@pytest.mark.parametrize("draw", [draw_success, draw_learned, draw_comparison])
def test_no_text_overlaps_or_is_cut(drawn, draw):
    (figure,) = drawn(draw, methods=("sac", "icm", "rnd", "mihm", "icm+hm", "mi", LONG), seeds=1, epochs=40)
    figure.draw_without_rendering()
    boxes = [text.get_window_extent().padded(-1) for text in drawn_texts(figure)]
    assert len(boxes) > 30
    for number, box in enumerate(boxes):
        assert box.x0 >= 0
        assert box.y0 >= 0
        assert box.x1 <= figure.bbox.width
        assert box.y1 <= figure.bbox.height
        assert not box.count_overlaps(boxes[:number])


def drawn_texts(figure):
    """All texts of a figure but those of ticks beyond the limits of their axis."""
    found = figure.findobj(lambda artist: isinstance(artist, Text) and artist.get_text() and artist.get_visible())
    beyond = set()
    for axis in (axis for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)):
        low, high = sorted(axis.get_view_interval())
        beyond |= {tick.label1 for tick in axis.get_major_ticks() if not low <= tick.get_loc() <= high}
    return [text for text in found if text not in beyond]


def test_curves_are_thinned_to_what_can_be_seen():
    for count, kept in ((500, MOST_POINTS), (41, 41), (1, 1)):
        epochs, values = thinned(np.arange(count), np.arange(count)[None])
        assert (len(epochs), epochs[0], epochs[-1]) == (kept, 0, count - 1)
        assert values[0].tolist() == epochs.tolist()


def test_goals_that_differ_within_a_task_are_an_error(make_runs):
    results = read_results(make_runs(seeds=2), every_goal=False)
    rows = results.evaluations
    lacking = rows[(rows["run"] != "stack2-mihm-1") | (rows["goal"] != "a on b")]
    with pytest.raises(ValueError, match="stack2-mihm-1 were not all evaluated on the goals of stack2-"):
        task_samples(replace(results, evaluations=lacking))


def names(paths):
    return [path.name for path in paths]


def test_each_task_has_its_own_files(make_runs, tmp_path):
    results = read_results(make_runs(tasks=("stack2", "stack3"), methods=("sac",), seeds=1), every_goal=False)
    paths = draw_figures(results, tmp_path, like="paper", formats=["png"])
    assert names(paths) == ["stack2-figure-4.png", "stack3-figure-4.png"]
    others = read_results(make_runs(methods=("lab:Mine",), seeds=1), every_goal=False)
    with pytest.raises(ValueError, match="no run of a method in the paper's figures"):
        draw_figures(others, tmp_path, like="paper")


def test_same_runs_give_the_same_bytes(make_runs, tmp_path):
    results = read_results(make_runs(methods=("sac", "icm+hm"), seeds=2), every_goal=False)
    formats = ("pdf", "png", "svg")
    first, second, spread = (
        draw_figures(results, tmp_path / folder, like="paper", formats=formats, processes=processes)
        for folder, processes in (("a", 1), ("b", 1), ("c", 3))
    )
    assert names(first) == [
        f"stack2-{name}.{suffix}" for name in ("figure-4", "figure-6c", "figure-7") for suffix in formats
    ]
    assert names(spread) == names(first)
    for path, again, elsewhere in zip(first, second, spread, strict=True):
        assert path.read_bytes() == again.read_bytes() == elsewhere.read_bytes()
    assert b"/CIDFontType2" in first[0].read_bytes()  # fonttype 42
    assert b"/Type3" not in first[0].read_bytes()


def test_paper_figures_have_the_papers_methods(make_runs, tmp_path, monkeypatch):
    captions = []
    monkeypatch.setattr("curiobench.analysis.figures.caption", lambda figure, text: captions.append((figure, text)))
    results = read_results(make_runs(methods=(*NINE, LONG), seeds=2), every_goal=False)
    draw_figures(results, tmp_path, like="paper", formats=["png"])
    (four, text), (share, _), (seven, _) = captions
    assert list(lines(four.axes[0])) == ["sac", "icm", "rnd", "dac", "re3", "mihm"]
    assert list(lines(share.axes[0])) == ["mihm", "icm+hm", "rnd+hm", "SomethingLong+hm"]
    assert list(lines(seven.axes[0])) == ["mihm", "icm+hm", "rnd+hm", "mi"]
    assert "Lines: mean over 2 seeds" in text
    assert "too few" in text


def test_caption_names_seeds_partial_runs_and_full_specs(make_runs, tmp_path, monkeypatch):
    captions = []
    monkeypatch.setattr("curiobench.analysis.figures.caption", lambda figure, text: captions.append(text))
    paths = make_runs(methods=("sac", LONG), seeds=3) + make_runs(methods=("icm",), seeds=1, complete=False)
    draw_figures(read_results(paths, partial=True, every_goal=False), tmp_path, formats=["png"])
    assert "1 to 3 seeds" in captions[0]
    assert "3 seeds of sac, SomethingLong+hm are too few to conclude" in captions[0]
    assert "1 seed of icm: no interval" in captions[0]
    assert "1 of 7 runs are partial" in captions[0]
    assert "SomethingLong is my_lab.curiosity:SomethingLong." in captions[0]


def test_command_prints_its_files_and_names_faults(make_runs, tmp_path, cli):
    make_runs(methods=("sac", "mihm"), seeds=1)
    make_runs(methods=("icm",), seeds=1, complete=False)
    out = tmp_path / "new" / "figures"
    code, printed, err = cli("figure", tmp_path / "runs", tmp_path / "none", "--out", out, "--format", "png")
    kinds = ["learning-curves", "learned-goals", "exploitation", "bonus", "heat-map", "profile", "comparison"]
    paths = [out / f"stack2-{kind}.png" for kind in kinds]
    assert printed.splitlines() == list(map(str, paths))
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in paths)
    partial, absent = err.splitlines()
    assert "stack2-icm-0 is partial" in partial
    assert (code, absent.partition("none does")[0]) == (2, f"curiobench: not in the figures: {tmp_path}/")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ((), "stack2-sac-0 is partial"),
        (("--partial", "--format", "pdf,jpg"), "unknown format 'jpg'; it must be one of pdf, png, svg"),
        (("--partial", "--like", "theirs"), "like is 'theirs'; it can be 'paper'"),
        (("--partial", "--out", "/dev/null/x"), "cannot write to /dev/null/x"),
    ],
)
def test_bad_input_takes_one_line_and_code_2(make_runs, cli, options, message):
    code, out, err = cli("figure", *make_runs(methods=("sac",), seeds=1, complete=False), *options)
    assert (code, out) == (2, "")
    assert message in err
    assert err.count("\n") == 1
