"""The runner: options, exit statuses, table, files, and that a run can be repeated from its own scenario."""

import dataclasses
import io
import json
import math
import os
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
import yaml
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LinearSystem

from saphari_drake.errors import ParameterError, SensorError, UnknownNameError
from saphari_drake.parameters import require_positive
from saphari_drake.robots.catalog import models_dir
from saphari_drake.simulation.record.log import Log
from saphari_drake.simulation.record.recorder import Recorder
from saphari_drake.simulation.runner.experiment import Experiment, main
from saphari_drake.simulation.runner.quick import shorten
from saphari_drake.simulation.runner.results import Metric, Outcome
from saphari_drake.simulation.runner.scenario import load_tree, with_assignments
from saphari_drake.simulation.runner.simulation import RunOptions, advance
from saphari_drake.simulation.view import mcap
from saphari_drake.simulation.view.figures import Panel, time_panels


@dataclass
class Spring:
    stiffness: float = 100.0  # N/m
    damping: float = 2.0  # Ns/m

    def __post_init__(self):
        require_positive(self, "stiffness", "damping")


@dataclass
class Damper:
    strength: list[float] | float = 1.0  # Ns/m


@dataclass
class Toy:
    case: str = "soft"
    seed: int = 0
    duration: float = 0.5
    robot: str = "mass"
    spring: Spring = field(default_factory=Spring)
    offset: np.ndarray = field(default_factory=lambda: np.array([0.1, 0.0]))
    bounds: list[float] = field(default_factory=lambda: [0.0, 1.0])
    mode: str = "on"
    controller: Spring | Damper = field(default_factory=Spring)
    parts: list[Spring] = field(default_factory=list)
    home: list[float] = field(default_factory=lambda: [90.0])
    extra: Spring | None = None
    recording: Path | None = None
    defect: str = ""


def scenario_for(case):
    return Toy(case=case, spring=Spring(400.0 if case == "stiff" else 100.0))


def build(scenario):
    builder = DiagramBuilder()
    k, d = scenario.spring.stiffness, scenario.spring.damping
    A = np.array([[0.0, 1.0], [-k, -d]])
    system = builder.AddSystem(LinearSystem(A, np.zeros((2, 0)), np.eye(2), np.zeros((2, 0))))
    recorder = Recorder(builder, 0.01)
    recorder.add("state", system.get_output_port(), "m, m/s")
    return builder.Build(), recorder


def run(scenario, options):
    assert isinstance(options, RunOptions)
    if scenario.defect == "memory":
        raise MemoryError
    if scenario.defect == "sensor":
        raise SensorError("the camera\nis gone")
    diagram, recorder = build(scenario)
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    start = scenario.offset + 1e-3 * np.random.default_rng(scenario.seed).standard_normal(2)
    context.SetContinuousState(start)
    wall = advance(simulator, scenario.duration, scenario.case)
    log = recorder.log(diagram, context)
    value = {"nan": math.nan, "miss": 99.0}.get(scenario.defect, float(np.abs(log["state"][:, 0]).max()))
    metrics = [
        Metric("peak_m", value, "m", *scenario.bounds, reported="0.1 m"),
        Metric("frequency", 1.0),
        Metric("cycle_ms_p95", 1e3 * wall + 1.0, "ms", high=1e-9),
    ]

    def draw():
        return time_panels(log, [Panel("State", ["state"], "x [m]")], "Figure 0: toy")

    def replay(path):
        path.write_text("<html></html>")

    return Outcome(metrics, log, draw, replay)


def toy(**changes):
    cases = {"soft": "A soft spring.", "stiff": "A stiff spring."}
    values = dict(name="toy", summary="A mass on a spring.", cases=cases, scenario_for=scenario_for, run=run)
    values |= dict(build_diagram=lambda scenario: build(scenario)[0]) | changes
    return Experiment(**values)


def one_error_line(capsys):
    captured = capsys.readouterr()
    lines = captured.err.strip().splitlines()
    assert len(lines) == 1 and lines[0].startswith("toy: error: "), captured.err
    return lines[0]


def test_all_cases_run_by_default_and_pass(capsys):
    assert main(toy(), []) == 0
    captured = capsys.readouterr()
    assert "toy / soft: A soft spring." in captured.out and "stiff: pass" in captured.out
    row = next(line for line in captured.out.splitlines() if line.startswith("peak_m"))
    assert row.split()[-1] == "pass" and "0 … 1" in row and "0.1 m" in row and " m " in row
    assert captured.err == ""  # no progress unless stderr is a terminal


def test_missed_bound_gives_1(capsys):
    assert main(toy(), ["--case", "soft", "--set", "bounds=[0.0, 0.01]"]) == 1
    assert "FAIL" in capsys.readouterr().out


def test_timing_never_decides(capsys):
    assert main(toy(), ["--case", "soft"]) == 0
    row = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("cycle_ms_p95"))
    assert row.endswith("(fail)")
    assert not Metric("step_ms", 1.0).decides and not Metric("step_ms_max", 1.0).decides
    assert Metric("error_msg", 1.0).decides


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_value_that_is_not_finite_misses_even_without_bounds(value):
    assert not Metric("x", value).met and Metric("x", value).verdict == "FAIL"


def test_nan_fails_and_is_null_in_json(tmp_path):
    assert main(toy(), ["--case", "soft", "--set", "defect=nan", "--out", str(tmp_path)]) == 1
    document = json.loads((tmp_path / "soft" / "metrics.json").read_text())
    assert document["metrics"]["peak_m"] is None and document["verdict"] == "fail"


def test_files_of_a_case(tmp_path):
    assert main(toy(), ["--out", str(tmp_path), "--seed", "4"]) == 0
    for case in ("soft", "stiff"):
        names = sorted(path.name for path in (tmp_path / case).iterdir())
        assert names == ["figure.png", "log.npz", "metrics.json", "replay.html", "scenario.yaml"]
    document = json.loads((tmp_path / "stiff" / "metrics.json").read_text())
    assert {"metrics", "bounds", "verdict", "scenario", "versions"} <= set(document)
    assert document["bounds"] == {"peak_m": [0.0, 1.0], "frequency": [None, None], "cycle_ms_p95": [None, 1e-9]}
    assert document["scenario"]["spring"]["stiffness"] == 400.0 and document["scenario"]["seed"] == 4
    assert set(document["versions"]) == {"saphari_drake", "drake", "numpy", "python"}
    log = Log.load(tmp_path / "soft" / "log.npz")
    assert log.units["state"] == "m, m/s" and log["state"].shape == (log.time.size, 2)
    with np.load(tmp_path / "soft" / "log.npz") as archive:
        assert json.loads(str(archive["units"]))["time"] == "s"


def test_mcap_needs_a_folder_and_its_package(tmp_path, capsys, monkeypatch):
    assert main(toy(), ["--mcap"]) == 2 and "--mcap: needs --out" in one_error_line(capsys)
    monkeypatch.setattr(mcap, "find_spec", lambda name: None)
    assert main(toy(), ["--mcap", "--out", str(tmp_path)]) == 2
    assert "pip install 'saphari_drake[mcap]'" in one_error_line(capsys) and not any(tmp_path.iterdir())


def test_mcap_is_one_file_more(tmp_path):
    pytest.importorskip("mcap_protobuf", reason="the extra 'mcap' is not installed")
    quiet = toy(run=lambda scenario, options: dataclasses.replace(run(scenario, options), replay=None))
    assert main(quiet, ["--case", "soft", "--mcap", "--out", str(tmp_path)]) == 0
    assert (tmp_path / "soft" / "run.mcap").read_bytes()[1:5] == b"MCAP"


def test_run_again_from_scenario_gives_the_same_metrics(tmp_path):
    first = ["--case", "stiff", "--seed", "7", "--set", "spring.damping=1e-1", "--set", "offset=[0.2, -1.5e-3]"]
    assert main(toy(), [*first, "--out", str(tmp_path / "a")]) == 0
    scenario = str(tmp_path / "a" / "stiff" / "scenario.yaml")
    assert main(toy(), ["--scenario", scenario, "--out", str(tmp_path / "b")]) == 0
    assert [path.name for path in (tmp_path / "b").iterdir()] == ["stiff"]
    before, after = (json.loads((tmp_path / x / "stiff" / "metrics.json").read_text()) for x in "ab")
    assert before["scenario"] == after["scenario"]
    assert before["metrics"]["peak_m"] == after["metrics"]["peak_m"]
    logs = [Log.load(tmp_path / x / "stiff" / "log.npz") for x in "ab"]
    np.testing.assert_array_equal(logs[0]["state"], logs[1]["state"])


def test_partial_scenario_applies_to_every_case(tmp_path, capsys):
    path = tmp_path / "some.yaml"
    path.write_text("spring:\n  damping: 5\n")
    assert main(toy(), ["--scenario", str(path), "--out", str(tmp_path)]) == 0
    trees = [json.loads((tmp_path / case / "metrics.json").read_text())["scenario"] for case in ("soft", "stiff")]
    assert [tree["spring"] for tree in trees] == [{"stiffness": k, "damping": 5.0} for k in (100.0, 400.0)]


def test_quick_shortens_before_anything_else_is_set(tmp_path):
    """A case lasts no longer than the experiment says, and what is given beside it comes after."""

    def durations(experiment, *arguments):
        assert main(experiment, [*arguments, "--out", str(tmp_path)]) == 0
        return [load_tree(tmp_path / case / "scenario.yaml")["duration"] for case in ("soft", "stiff")]

    long = toy(scenario_for=lambda case: dataclasses.replace(scenario_for(case), duration=2.5))
    assert durations(long) == [2.5, 2.5]
    assert durations(long, "--quick") == [2.0, 2.0] and durations(toy(), "--quick") == [0.5, 0.5]
    assert durations(long, "--quick", "--duration", "0.3") == [0.3, 0.3]
    own = dataclasses.replace(long, quick=lambda scenario: shorten(scenario, 0.1 if scenario.case == "soft" else 0.2))
    assert durations(own, "--quick") == [0.1, 0.2]


def test_list_cases(capsys):
    assert main(toy(), ["--list-cases"]) == 0
    assert capsys.readouterr().out.splitlines() == ["soft   A soft spring.", "stiff  A stiff spring."]


def test_a_case_without_chance_says_so(tmp_path, capsys):
    """In the list, in the heading of its table, and in metrics.json; the other case has another seed's numbers."""
    experiment = toy(seedless=frozenset({"stiff"}))
    assert main(experiment, ["--list-cases"]) == 0
    assert capsys.readouterr().out.splitlines()[1] == "stiff  A stiff spring.; a seed changes nothing"
    assert main(experiment, ["--out", str(tmp_path)]) == 0
    assert "toy / stiff: A stiff spring.; a seed changes nothing" in capsys.readouterr().out
    documents = {case: json.loads((tmp_path / case / "metrics.json").read_text()) for case in ("soft", "stiff")}
    assert documents["soft"]["seed_matters"] and documents["stiff"]["seed_matters"] is False
    assert documents["stiff"]["verdict"] == "pass"
    with pytest.raises(UnknownNameError, match="no case 'hard'"):
        toy(seedless=frozenset({"hard"}))


def test_help_shows_examples(capsys):
    with pytest.raises(SystemExit) as stop:
        main(toy(), ["--help"])
    assert stop.value.code == 0 and "python diagrams/toy.py --list-cases" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--case", "hard"], ["no case 'hard'", "soft, stiff"]),
        (["--set", "spring.mass=1"], ["no parameter 'spring.mass'", "spring.stiffness, spring.damping"]),
        (["--set", "springs.mass=1"], ["no parameter 'springs'", "duration", "offset"]),
        (["--set", "spring.stiffness=abc"], ["spring.stiffness: needs a number, got 'abc'"]),
        (["--set", "spring.stiffness=true"], ["spring.stiffness: needs a number"]),
        (["--set", "spring.stiffness=[1, 2]"], ["spring.stiffness: needs a number"]),
        (["--set", "spring.stiffness.x=3"], ["spring.stiffness: needs a number"]),
        (["--set", "spring=3"], ["spring: holds parameters of its own"]),
        (["--set", "spring.stiffness=-3"], ["spring.stiffness: must be positive"]),
        (["--set", "spring.stiffness=[1, "], ["spring.stiffness", "not a YAML value"]),
        (["--set", "seed=1.5"], ["seed: needs a whole number"]),
        (["--set", "offset=abc"], ["offset: needs", "ndarray", "got 'abc'"]),
        (["--set", "bounds=[0, x]"], ["bounds: needs list[float], got [0, 'x']"]),
        (["--set", "bounds=12"], ["bounds: needs list[float], got 12"]),
        (["--set", "parts=[{mass: 3}]"], ["no parameter 'parts[0].mass'", "parts[0].stiffness"]),
        (["--set", "parts=[{stiffness: -3}]"], ["parts[0].stiffness: must be positive"]),
        (["--set", "controller.strength=3"], ["no parameter 'controller.strength'", "controller.stiffness"]),
        (["--set", "controller=!Motor {}"], ["no kind of controller '!Motor'", "!Spring, !Damper"]),
        (["--set", "controller=!Damper {strength: strong}"], ["controller.strength: needs", "got 'strong'"]),
        (["--set", "case=stiff"], ["choose it with --case"]),
        (["--set", "seed"], ["needs PATH=VALUE"]),
        (["--duration", "0"], ["duration: must be finite and at least 0.02 s"]),
        (["--duration", "1e-9"], ["duration: must be finite and at least 0.02 s"]),
        (["--duration", "nan"], ["duration: must be finite"]),
        (["--duration", "inf"], ["duration: must be finite"]),
        (["--duration", "soon"], ["--duration", "soon"]),
        (["--seed", "-1"], ["seed: must not be negative"]),
        (["--scenario", "missing.yaml"], ["missing.yaml: No such file"]),
        (["--model", "x.urdf"], ["--model", "own robot"]),
        (["--frobnicate"], ["--frobnicate"]),
        (["--out", ""], ["--out: needs a path"]),
        (["--graphviz", "x.foo"], ["--graphviz", "writes .dot, .gv, .svg, .png or .pdf, not 'x.foo'"]),
        (["--set", "parts=[{stiffness: 1, foo: 3}]"], ["no parameter 'parts[0].foo'", "parts[0].damping"]),
        (["--set", "parts=[1]"], ["parts[0]: holds parameters of its own"]),
    ],
)
def test_bad_input_gives_2_and_one_line(arguments, said, capsys, tmp_path):
    assert main(toy(), [*arguments, "--out", str(tmp_path / "out")]) == 2
    line = one_error_line(capsys)
    assert all(text in line for text in said), line
    assert not (tmp_path / "out").exists()  # found before anything ran


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a: [1,\nb", "not YAML"),
        ("- 1\n- 2", "needs names with values"),
        ("spring: {mass: 1}", "no parameter 'spring.mass'"),
        ("case: hard", "no case 'hard'"),
        ("case: stiff", "scenario of case 'stiff'"),
        ("spring: 4", "spring: holds parameters"),
    ],
)
def test_bad_scenario_file_gives_2_and_one_line(text, said, capsys, tmp_path):
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    clash = ["--case", "soft"] if "stiff" in text else []
    assert main(toy(), ["--scenario", str(path), *clash]) == 2
    assert said in one_error_line(capsys)


@pytest.mark.parametrize("strength", ["2", "2.0", "[2, 3]", "2e-1"])
def test_a_tag_chooses_the_kind_of_a_controller_and_is_kept_in_the_file(tmp_path, strength):
    """Chosen by a tag, its own parameters are set as any others; the file of the run names the same kind."""
    seen = []

    def look(scenario, options):
        seen.append(scenario)
        return run(scenario, options)

    choice = ["--set", "controller=!Damper {}", "--set", f"controller.strength={strength}"]
    assert main(toy(run=look), ["--case", "soft", *choice, "--out", str(tmp_path)]) == 0
    assert main(toy(run=look), ["--scenario", str(tmp_path / "soft" / "scenario.yaml")]) == 0
    first, second = seen
    assert first.controller == Damper(yaml.safe_load(strength.replace("2e-1", "0.2")))
    assert second.controller == first.controller and isinstance(second.controller, Damper)
    np.testing.assert_array_equal(first.offset, second.offset)
    again = with_assignments(second, ["controller=!Spring {damping: 5}"])
    assert again.controller == Spring(damping=5.0) and second.controller == first.controller


def test_words_reach_text_fields_as_typed():
    seen = []

    def look(scenario, options):
        seen.append(scenario)
        return run(scenario, options)

    settings = ["mode=off", "recording=7", "extra={stiffness: 3}", "extra.damping=4", "spring={damping: 1.0e-2}"]
    arguments = [part for text in settings for part in ("--set", text)]
    assert main(toy(run=look), ["--case", "soft", *arguments]) == 0
    (scenario,) = seen
    assert scenario.mode == "off" and scenario.recording == Path("7")
    assert scenario.extra == Spring(3.0, 4.0) and scenario.spring == Spring(100.0, 0.01)


def test_a_case_that_cannot_run_leaves_the_others(capsys, tmp_path):
    def scenarios(case):
        return Toy(case=case, defect="sensor" if case == "soft" else "")

    assert main(toy(scenario_for=scenarios), ["--out", str(tmp_path)]) == 2
    assert one_error_line(capsys) == "toy: error: case soft: the camera is gone"
    assert (tmp_path / "stiff" / "metrics.json").is_file()


def test_figure_that_cannot_be_drawn_leaves_the_numbers_and_no_half_files(tmp_path):
    def broken(scenario, options):
        outcome = run(scenario, options)

        def replay(path):
            path.write_text("half")
            raise SensorError("no view")

        return Outcome(outcome.metrics, outcome.log, outcome.draw, replay)

    assert main(toy(run=broken), ["--case", "soft", "--out", str(tmp_path)]) == 2
    names = sorted(path.name for path in (tmp_path / "soft").iterdir())
    assert names == ["figure.png", "log.npz", "metrics.json", "scenario.yaml"]


def test_results_of_an_earlier_run_do_not_outlive_a_failed_one(tmp_path):
    arguments = ["--case", "soft", "--out", str(tmp_path)]
    assert main(toy(), arguments) == 0
    assert main(toy(), [*arguments, "--set", "defect=sensor"]) == 2
    assert [path.name for path in (tmp_path / "soft").iterdir()] == ["scenario.yaml"]
    assert "defect: sensor" in (tmp_path / "soft" / "scenario.yaml").read_text()


def test_a_shortened_run_judges_what_it_came_to(capsys):
    """What it did not come to is NaN, and named; in a run of full length it misses."""
    assert main(toy(), ["--case", "soft", "--set", "defect=nan", "--duration", "0.3"]) == 0
    told = capsys.readouterr().out
    assert "soft: pass (not judged: the run ended before: peak_m)" in told and "nan" not in told
    assert main(toy(), ["--case", "soft", "--set", "defect=nan"]) == 1


def test_too_little_memory_is_told(capsys):
    assert main(toy(), ["--case", "soft", "--set", "defect=memory"]) == 2
    assert "case soft: there is not enough memory" in one_error_line(capsys)


def test_reader_that_goes_away_does_not_end_the_run(tmp_path):
    script = tmp_path / "toy.py"
    script.write_text(f"""import sys
sys.path.insert(0, {str(Path(__file__).parent)!r})
from test_experiment import main, toy
sys.exit(main(toy(), ["--out", {str(tmp_path / "out")!r}]))
""")
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run([sys.executable, script], stdout=writing, stderr=subprocess.PIPE, check=False)
    os.close(writing)
    assert done.returncode == 0 and done.stderr == b""
    assert len(list((tmp_path / "out").glob("*/metrics.json"))) == 2


def test_metric_named_twice_is_refused():
    with pytest.raises(ParameterError, match="named more than once: x"):
        Outcome([Metric("x", 1.0), Metric("x", 2.0)], Log([0.0]), lambda: None)


def test_model_is_taken_where_allowed(tmp_path, capsys):
    model = models_dir() / "planar_6r" / "planar_6r.urdf"

    def adapt(scenario, robot):
        assert robot.n == 6
        scenario.home = []

    experiment = toy(adapt=adapt)
    own = tmp_path / "own.yaml"
    own.write_text("home: [45]")
    # The case's posture is not that of another robot; one that is given is.
    for more, home in ([], []), (["--set", "home=[30]"], [30.0]), (["--scenario", str(own)], [45.0]):
        assert main(experiment, ["--case", "soft", "--model", str(model), "--out", str(tmp_path), *more]) == 0
        scenario = json.loads((tmp_path / "soft" / "metrics.json").read_text())["scenario"]
        assert scenario["robot"] == str(model) and scenario["home"] == home
    capsys.readouterr()
    assert main(experiment, ["--model", "missing.urdf"]) == 2
    assert "no file 'missing.urdf'" in one_error_line(capsys)


def test_graphviz_writes_the_diagram_and_stops(tmp_path, capsys):
    assert main(toy(), ["--graphviz", str(tmp_path / "toy.dot")]) == 0
    assert (tmp_path / "toy.dot").read_text().startswith("digraph") and "metric" not in capsys.readouterr().out
    assert main(toy(build_diagram=None), ["--graphviz", str(tmp_path / "x.dot")]) == 2
    assert "no block diagram" in one_error_line(capsys)


def test_out_that_is_a_file_gives_2_before_running(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert main(toy(), ["--out", str(tmp_path / "file")]) == 2
    assert "file" in one_error_line(capsys)


def test_live_view_prints_its_address(capsys, monkeypatch):
    monkeypatch.setattr("sys.stdin", io.StringIO())
    assert main(toy(), ["--case", "soft", "--meshcat"]) == 0
    assert "Meshcat: http" in capsys.readouterr().out


def test_progress_on_a_terminal_only(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    diagram, _ = build(Toy())
    simulator = Simulator(diagram)
    wall = advance(simulator, 0.35, "soft")
    assert simulator.get_context().get_time() == pytest.approx(0.35) and wall > 0.0
    assert "soft 0.3 s of 0.35 s, 100%" in terminal.getvalue() and terminal.getvalue().endswith("\n")


def test_log_round_trip_and_errors(tmp_path):
    log = Log([0.0, 1.0])
    log.add("file", [[1.0, 2.0], [3.0, 4.0]], "N·m")
    log.save(tmp_path / "log.npz")
    again = Log.load(tmp_path / "log.npz")
    np.testing.assert_array_equal(again["file"], log["file"])
    assert again.units == {"file": "N·m"}
    with pytest.raises(KeyError, match="no signal 'x'; there are: file"):
        log["x"]
    with pytest.raises(ValueError, match="needs 2 rows"):
        log.add("y", [1.0, 2.0, 3.0])
    (tmp_path / "bad.npz").write_text("no")
    with pytest.raises(SensorError, match="not a log"):
        Log.load(tmp_path / "bad.npz")
