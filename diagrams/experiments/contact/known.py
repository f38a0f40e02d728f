"""What is known of an arm's encoders, turned into parameters of the contact pipeline."""

import math

import numpy as np
from numpy.typing import NDArray

from saphari_drake.estimation.momentum_observer import MomentumObserverParameters, discrete_gain
from saphari_drake.parameters import diagonal
from saphari_drake.pipelines.contact import ContactPipelineParameters
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.sensors.joint_sensor import JointSensorParameters

Array = NDArray[np.float64]
MOST_AVERAGED = 8  # periods; 17 ms of lag at 5 ms. Assumed
TURN_STEPS = 10.0  # steps of an encoder over which friction turns round. Assumed


def encoder_error(robot: RobotModel, sensor: JointSensorParameters, observer: MomentumObserverParameters) -> Array:
    """Return the largest error (n,) of the residual of slow joints (Nm) before it is averaged.

    Two positions, each wrong by up to half a step, make the velocity wrong by a step over the period. The momentum's
    error passes the observer as K_I times itself.
    """
    if not sensor.differentiate:
        return np.zeros(robot.n)
    M = evaluate_dynamics(robot, robot.home, np.zeros(robot.n)).M
    gain = discrete_gain(diagonal(observer.gain, robot.n, "gain"), sensor.period)
    return gain * np.diag(M) * sensor.position_resolution / sensor.period


def adapt_to_encoders(pipeline: ContactPipelineParameters, robot: RobotModel, sensor: JointSensorParameters) -> None:
    """Average the residual until the encoders' error stays below the detector's threshold."""
    observer = pipeline.observer
    threshold = diagonal(pipeline.detector.threshold, robot.n, "threshold")
    periods = math.ceil(float(np.max(encoder_error(robot, sensor, observer) / threshold)))
    observer.averaged = max(observer.averaged, min(periods, MOST_AVERAGED))


def adapt_to_friction(pipeline: ContactPipelineParameters, sensor: JointSensorParameters) -> None:
    """Let known friction turn round over what the encoders can tell."""
    friction = pipeline.observer.friction
    friction.turn = max(friction.turn, TURN_STEPS * sensor.position_resolution)
