"""One robot, simulated or real, behind the same ports: a touch answered, a body that yields, a hand that leads.

--robot says which one: sim (default), fci://HOST for Franka's arms (extra 'franka'), lcm or lcm://URL for a KUKA iiwa's
driver. A real robot starts where it is. It needs its model: --model FILE (default: the FR3 that is shipped).

There is no camera and no skin here. A touch is answered at a declared place (rod.link, rod.aim), the force of a hand
that leads is that of the tip (touch.guiding.tip_point), out of the joints' residual. On a simulated robot a rod does
what the person would: the same in Drake and, over the FCI, in MuJoCo (experiments/hardware).

BEFORE A REAL ROBOT: the emergency stop at hand, nobody within reach but who pushes, reduced speed first.
"""

import sys
from collections.abc import Sequence

from experiments.hardware.cell import SIM, HardwareScenario, build
from experiments.hardware.figures import figure, replay
from experiments.hardware.judge import judged
from experiments.hardware.run import run_case
from experiments.placement.arm import keep
from pydrake.systems.framework import Diagram

from saphari_drake.simulation.runner.experiment import Experiment, main
from saphari_drake.simulation.runner.quick import shorten
from saphari_drake.simulation.runner.results import Outcome
from saphari_drake.simulation.runner.simulation import RunOptions

CASES = {
    "contact_impedance": "a touch at a declared place is answered by an impedance (Section 7)",
    "null_space": "the body yields to a push, the end effector stays (Section 5)",
    "hand_guiding": "a hand leads the tip; its force is the residual's (Section 6 without skin and wrist sensor)",
}


def scenario_for(case: str) -> HardwareScenario:
    """Return the scenario of a case."""
    scenario = HardwareScenario(case=case)
    rod, guiding = scenario.rod, scenario.touch.guiding
    guiding.tip_point = [0.0, 0.0, 0.08]
    if case == "null_space":
        rod.link, rod.aim = "fr3_link3", [0.0, 0.0, -0.1]
    elif case == "hand_guiding":
        rod.link, rod.aim, rod.force = "fr3_link7", [0.0, 0.0, 0.08], 8.0
        rod.speed, rod.travel, rod.hold, scenario.duration = 0.6, 0.6, 2.0, 4.0
    return scenario


def build_diagram(scenario: HardwareScenario) -> Diagram:
    """Return the diagram of a scenario with its simulated robot."""
    return build(scenario, scenario.loaded(scenario.home)).diagram


def run(scenario: HardwareScenario, options: RunOptions) -> Outcome:
    """Run a scenario and judge it."""
    result = run_case(scenario, options)
    return Outcome(judged(result), result.log, lambda: figure(result), lambda path: replay(result, path))


def with_address(argv: Sequence[str]) -> list[str]:
    """Return arguments with ``--robot X`` as the scenario's address."""
    arguments = [part for given in argv for part in (given.split("=", 1) if given.startswith("--robot=") else [given])]
    while "--robot" in arguments:
        k = arguments.index("--robot")
        arguments[k : k + 2] = ["--set", f"address={arguments[k + 1] if k + 1 < len(arguments) else SIM}"]
    return arguments


EXPERIMENT = Experiment(
    "hardware",
    __doc__,
    CASES,
    scenario_for,
    run,
    build_diagram,
    adapt=keep,
    seedless=frozenset(CASES),
    quick=lambda scenario: shorten(scenario, 3.0),
)


if __name__ == "__main__":
    sys.argv[1:] = with_address(sys.argv[1:])
    sys.exit(main(EXPERIMENT))
