"""The definition of a grid: flags, YAML files, cells and their folders, and grid.json."""

import json
import re
import shlex
from pathlib import Path

import pytest
from fake_grid import make_cells

from curiobench.cli.arguments import GridArguments
from curiobench.cli.parsing import parse_arguments
from curiobench.cli.train_arguments import parse_train
from curiobench.grid.cells import GRID_FILE, cells_of, folder_name, write_record
from curiobench.grid.definition import Grid, define, read_definition
from curiobench.options import flatten

EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "ablation.yaml"


def grid_of(*flags) -> Grid:
    return define(parse_arguments(GridArguments, "grid", ["--out", "none", *map(str, flags)]))


@pytest.fixture
def yaml(tmp_path):
    """Writes a file and gives its path."""

    def write(text):
        path = tmp_path / "grid.yaml"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


@pytest.mark.parametrize(("text", "seeds"), [("3", [0, 1, 2]), ("4,7", [4, 7]), ("4,", [4])])
def test_seeds(text, seeds):
    assert grid_of("--tasks", "stack2", "--methods", "sac", "--seeds", text).seeds == seeds


def test_flags_override_the_file(yaml):
    path = yaml(
        "tasks: [stack2]\nmethods: [sac, icm+hm]\nseeds: 2\npreset: smoke\n"
        "options: {epochs: 7, batch_size: 8}\nvariants: {wide: {sac.hidden: 128}, base: }"
    )
    grid = grid_of(path, "--methods", "rnd", "--seeds", "5,", "--options", "epochs=9,machine.keep-replay=TRUE")
    assert grid == Grid(
        ["stack2"],
        ["rnd"],
        [5],
        "smoke",
        "gripper",
        {"epochs": "9", "batch-size": "8", "machine.keep-replay": True},
        {"wide": {"sac.hidden": "128"}, "base": {}},
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("tasks: [stack2", "line 1: expected"),
        ("methods: [a]\ntasks: [a]\nmethods: [b]", "line 1: the key 'methods' is given more than once"),
        ("options: {epochs: 1, epochs: 2}", "the key 'epochs' is given more than once"),
        ("options: {batch-size: 1, batch_size: 2}", "the option 'batch-size' is given more than once"),
        ("task: stack2", "unknown key 'task': did you mean 'tasks'? the keys are tasks, methods, seeds"),
        ("tasks: stack2", "tasks is 'stack2'; expected a list of names"),
        ("methods: [no]", "methods is a list; expected a list of names"),
        ("seeds: 1.5", "seeds is '1.5'; expected a number of seeds"),
        ("seeds: 1:30", "seeds is '1:30'; expected"),
        ("preset: [laptop]", "preset is a list"),
        ("options: [epochs]", "options is a list; expected keys with values"),
        ("options: {sac: {gamma: 1}}", "options: sac is a mapping; expected a number"),
        ("options: {on: 2}", "the key True is True; put it in quotes"),
        ("variants: {../up: {}}", "variant '../up': names use letters"),
        ("variants: {}", "variants is empty"),
        ("variants: {a: 1}", "variant a is '1'; expected keys with values"),
        ("- a", "the file is a list"),
        ("", "the file is empty"),
        ('seeds: !!int ""', "cannot read"),
        ('preset: "\\UFFFFFFFF"', "cannot read"),
        ("options: &a {epochs: 1}\nvariants: {x: {<<: *a}}", "merge keys (<<) are not allowed"),
        ("tasks: !!python/object/apply:os.system [ls]", "could not determine a constructor"),
        (b"\xff\xfe\xff", "cannot read"),
        ("[" * 5000, "recursion"),
    ],
)
def test_a_faulty_file_takes_one_line(yaml, text, message):
    path = yaml(text)
    with pytest.raises(ValueError, match=re.escape(message)) as refused:
        read_definition(path)
    assert str(path) in str(refused.value)
    assert "\n" not in str(refused.value)


NUMBERS = {
    **{"sac.learning-rate": ("1e-3", 1e-3), "sac.gamma": (".5", 0.5), "sac.polyak": ("5.0e-2", 0.05)},
    **{"epochs": ("012", 12), "batch-size": ("1_000", 1000), "worlds": ("+8", 8)},
    **{
        "machine.keep-replay": ("yes", True),
        "replay.satisfied-cap": ("~", None),
        "sac.tune-temperature": ("off", False),
    },
}


def test_a_number_in_a_file_is_what_the_command_line_would_read(yaml, tmp_path):
    path = yaml("seeds: [1, 012]\noptions:\n" + "".join(f"  {name}: {text}\n" for name, (text, _) in NUMBERS.items()))
    cell = cells_of(grid_of(path, "--tasks", "stack2", "--methods", "sac", "--preset", "smoke"), tmp_path)[1]
    options = flatten(cell.config.to_json())
    assert {name: options[name.replace("-", "_")] for name in NUMBERS} == {
        n: value for n, (_, value) in NUMBERS.items()
    }
    assert cell.config.seed == 12


@pytest.mark.parametrize(
    ("name", "text"),
    [
        *(("epochs", text) for text in ("1e3", "0x10", "1:30", "7.0", "2026-01-01", "yes", ".inf", "nan")),
        *(("sac.gamma", text) for text in (".nan", "nan", "1:30", "true")),
        *(("sac.learning-rate", text) for text in ("nan", "inf", "-.inf")),
    ],
)
def test_what_is_no_such_number_is_refused_in_one_line(yaml, tmp_path, name, text):
    path = yaml(f"tasks: [stack2]\nmethods: [sac]\noptions: {{{name}: {text}}}")
    with pytest.raises(ValueError, match="stack2 sac: ") as refused:
        cells_of(grid_of(path), tmp_path)
    assert "\n" not in str(refused.value)


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(ValueError, match=r"cannot read .*none.yaml: No such file"):
        read_definition(tmp_path / "none.yaml")


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--tasks", "stack2", "--methods", "sac,icm,sac"], "methods: sac is given more than once"),
        (["--tasks", "stack2", "--methods", "sac", "--seeds", "0"], "the grid has no seeds"),
        (["--tasks", "stack2", "--methods", "sac", "--seeds", "-1,2"], "seeds has -1"),
        (["--tasks", "stack2", "--methods", "sac", "--seeds", "few"], "seeds is 'few'"),
        (["--tasks", "stack2", "--methods", "sac", "--seeds", "99999999999"], "99999999999 seeds, at most 1000"),
        (["--tasks", "stack2", "--methods", "sac", "--seeds", "2147483648,"], "seeds has 2147483648; a seed must be"),
        (["--tasks", "stack2", "--methods", "sac", "--options", "epochs"], "options: 'epochs' has no value"),
        (["--tasks", "stack2", "--methods", "sac", "--options", "epochs=1,epochs=2"], "'epochs' is given more than"),
    ],
)
def test_faulty_flags(flags, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        grid_of(*flags)


def test_a_cell_for_every_task_method_variant_and_seed_the_first_seed_first(tmp_path):
    grid = Grid(["stack2", "stack3"], ["sac", "mi+hm"], [0, 4], "smoke", variants={"a": {}, "b": {"epochs": 2}})
    cells = cells_of(grid, tmp_path)
    assert len({cell.folder for cell in cells}) == 16
    assert [cell.folder for cell in cells[:4]] == [
        "stack2-sac-a-0",
        "stack2-sac-b-0",
        "stack2-mihm-a-0",
        "stack2-mihm-b-0",
    ]
    assert [cell.config.seed for cell in cells] == [0] * 8 + [4] * 8
    assert [cell.config.epochs for cell in cells[:2]] == [5, 2]
    assert cells[2].method == "mihm"
    assert cells[2].config.method == "mi+hm"


def test_the_command_of_a_cell_gives_its_config(tmp_path):
    options = {
        "epochs": 3,
        "replay.satisfied-cap": None,
        "sac.tune-temperature": True,
        "machine.keep-replay": False,
        "method.eta": 0.5,
    }
    cell = cells_of(Grid(["stack2"], ["icm"], [3], "smoke", "fetch", options), tmp_path)[0]
    parsed = parse_train(cell.arguments)
    assert parsed.config == cell.config
    assert (parsed.out, parsed.resume) == (cell.path, True)
    assert (cell.config.sac.tune_temperature, cell.config.method_config.eta) == (True, 0.5)
    assert (cell.config.replay.satisfied_cap, cell.config.robot, cell.config.seed) == (None, "fetch", 3)


@pytest.mark.parametrize(
    ("grid", "message"),
    [
        (Grid(["stack9"], ["sac"]), "stack9 sac: unknown task 'stack9'"),
        (Grid(["stack2"], ["sca"]), "unknown method 'sca'; the nearest is 'sac'"),
        (Grid(["stack2"], ["mihm", "mi+hm"]), "two cells would share the folder stack2-mihm-0"),
        (Grid(["stack2"], ["sac"], preset="lap"), "unknown preset 'lap'"),
        (Grid(["stack2"], ["sac"], options={"epoch": 3}), "unknown option 'epoch': did you mean 'epochs'?"),
        (Grid(["stack2"], ["sac"], options={"help": ""}), "unknown option 'help'"),
        (Grid(["stack2"], ["sac"], options={"tyro-write-completion": "x"}), "unknown option 'tyro-write-completion'"),
        (Grid(["stack2"], ["sac"], options={"out": "/tmp/x"}), "unknown option 'out'"),
        (Grid(["stack2"], ["sac"], options={"seed": 3}), "seed cannot be given in options; use --seeds"),
        (Grid(["stack2"], ["sac"], options={"robot": "fetch"}), "robot cannot be given in options; use --robot"),
        (Grid(["stack2"], ["sac"], options={"epochs": "--resume"}), "stack2 sac: "),
        (Grid(["stack2"], ["sac"], options={"epochs": True}), "stack2 sac: "),
        (Grid(["stack2"], ["sac"], options={"epochs": -3}), "stack2 sac: epochs is -3; it must be at least 1"),
        (Grid(["stack2"], ["sac"], options={"method.eta": 3}), "stack2 sac: Unrecognized options: --method.eta"),
        (Grid(["stack2"], ["sac"], variants={"w": {"sac.width": 3}}), "unknown option 'sac.width'"),
    ],
)
def test_every_cell_is_checked_before_anything_starts(tmp_path, grid, message):
    with pytest.raises(ValueError, match=re.escape(message)) as refused:
        cells_of(grid, tmp_path)
    assert "\n" not in str(refused.value)


def test_folder_names():
    assert folder_name("pkg.mod:Class+hm") == "pkg.mod.Class+hm"
    assert "/" not in folder_name("../pkg.mod:Class")


def test_the_record_of_a_folder_holds_the_cells_of_all_its_grids(tmp_path):
    first, second = make_cells(tmp_path), make_cells(tmp_path, "--methods", "icm,mihm", "--seeds", "1")
    write_record(tmp_path, first, ["curiobench", "grid", "--out", "a b"])
    write_record(tmp_path, second, ["curiobench", "grid", "other"])
    write_record(tmp_path, first[:1], ["curiobench", "grid", "other"])
    record = json.loads((tmp_path / GRID_FILE).read_text())
    assert record["commands"] == ["curiobench grid --out 'a b'", "curiobench grid other"]
    folders = ["stack2-sac-0", "stack2-icm-0", "stack2-sac-1", "stack2-icm-1", "stack2-mihm-0"]
    assert [cell["folder"] for cell in record["cells"]] == folders
    mihm = record["cells"][-1]
    assert (mihm["task"], mihm["method"], mihm["seed"], mihm["variant"]) == ("stack2", "mihm", 0, "")
    assert shlex.split(mihm["command"]) == list(second[1].command)


def test_a_damaged_record_is_named_and_kept(tmp_path):
    (tmp_path / GRID_FILE).write_text('{"format": "x"}')
    with pytest.raises(ValueError, match=r"grid\.json was not written by `curiobench grid`"):
        write_record(tmp_path, make_cells(tmp_path), [])
    assert (tmp_path / GRID_FILE).read_text() == '{"format": "x"}'


def test_the_example_of_the_docs_is_a_grid(tmp_path):
    cells = cells_of(grid_of(EXAMPLE), tmp_path)
    assert len(cells) == len({cell.folder for cell in cells}) > 3
