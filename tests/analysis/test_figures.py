"""What is in the figures, seen in their Axes, and what `curiobench figure` writes."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.text import Text
from plots import lines
from synthetic import LONG, NINE, uneven

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
from curiobench.analysis.statistics import curve_interval
from curiobench.analysis.style import theme


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
    first, spread = (
        draw_figures(results, tmp_path / str(n), like="paper", formats=formats, processes=n) for n in (1, 3)
    )
    assert names(first) == [
        f"stack2-{name}.{suffix}" for name in ("figure-4", "figure-6c", "figure-7") for suffix in formats
    ]
    assert names(spread) == names(first)
    for path, again in zip(first, spread, strict=True):
        assert path.read_bytes() == again.read_bytes()
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
