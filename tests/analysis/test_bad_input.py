"""Commands on results: what is wrong with their input takes one line, and exit code 2."""

import re
import shlex

import pytest


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("table RUNS --baseline icm --like paper", "--baseline is for the tables of methods, not for --like paper"),
        ("table RUNS --baseline icm --each-run", "--baseline is for the tables of methods, not for single runs"),
        ("table RUNS --each-run --like paper", "--like paper and --each-run are different tables"),
        ("table RUNS --out ''", "--out is empty"),
        ("table RUNS --out=", "--out is empty"),
        ("table RUNS --baseline icm", "no run has the baseline 'icm'; the methods are sac, mihm"),
        ("figure NONE", "no run to draw; NONE does not exist"),
        ("figure RUNS --format pdf,jpg", "unknown format 'jpg'; it must be one of pdf, png, svg"),
        ("figure RUNS --like theirs", "like is 'theirs'; it can be 'paper'"),
        ("figure RUNS --out /dev/null/x", "cannot write to /dev/null/x"),
        ("report", "name at least one run folder"),
        ("report NONE", "no run to report on; NONE does not exist"),
        ("report RUNS --out RUNS", "it is a folder"),
        ("report RUNS --baseline rnd", "no run has the baseline 'rnd'"),
        ("submit-check", "name at least one run folder"),
        ("submit-check RUNS --against v99", "there are no published results 'v99'"),
    ],
)
def test_bad_input_takes_one_line(cli, make_runs, tmp_path, command, message):
    make_runs(seeds=1)
    command, message = (
        text.replace("RUNS", f"{tmp_path}/runs").replace("NONE", f"{tmp_path}/none") for text in (command, message)
    )
    code, out, err = cli(*shlex.split(command))
    assert (code, out) == (2, "")
    assert re.fullmatch(r"curiobench: [^\n]+\n", err)
    assert message in err
