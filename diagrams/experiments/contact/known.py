"""What is known of an arm's encoders and friction, turned into parameters of the contact pipeline."""

import math

import numpy as np
from numpy.typing import NDArray

from saphari_drake.estimation.joint_friction import JointFrictionParameters
from saphari_drake.estimation.momentum_observer import MomentumObserverParameters, discrete_gain
from saphari_drake.parameters import diagonal
from saphari_drake.pipelines.contact import ContactPipelineParameters
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.sensors.joint_sensor import JointSensorParameters

Array = NDArray[np.float64]
MOST_AVERAGED = 8  # periods; 17 ms of lag at 5 ms. Assumed
TURN_STEPS = 10.0  # steps of an encoder over which friction turns round. Assumed


def encoder_noise(robot: RobotModel, sensor: JointSensorParameters, observer: MomentumObserverParameters) -> Array:
    """Return the standard deviation (n,) of the residual in motion (Nm), before it is averaged.

    Two positions, each wrong by up to half a step, make the velocity: √(1/6) steps over the period. The momentum's
    error passes the observer as K_I times itself.
    """
    if not sensor.differentiate:
        return np.zeros(robot.n)
    velocity = sensor.position_resolution / math.sqrt(6.0) / sensor.period
    M = evaluate_dynamics(robot, robot.home, np.zeros(robot.n)).M
    return discrete_gain(diagonal(observer.gain, robot.n, "gain"), sensor.period) * np.diag(M) * velocity


def adapt_to_encoders(pipeline: ContactPipelineParameters, robot: RobotModel, sensor: JointSensorParameters) -> None:
    """Average the residual until the detector's threshold is above the encoders' noise, and tell it the rest."""
    observer, detector = pipeline.observer, pipeline.detector
    noise = encoder_noise(robot, sensor, observer)
    share = float(np.max(detector.noise_multiple * noise / diagonal(detector.threshold, robot.n, "threshold")))
    observer.averaged = int(np.clip(math.ceil(share), observer.averaged, MOST_AVERAGED))
    own = diagonal(detector.noise, robot.n, "noise")
    detector.noise = np.hypot(own, noise / observer.averaged).tolist()


def adapt_to_friction(pipeline: ContactPipelineParameters, robot: RobotModel, sensor: JointSensorParameters) -> None:
    """Tell the observer the friction that was identified, if any."""
    known = robot.friction
    if np.any(known.coulomb) or np.any(known.viscous):
        turn = max(JointFrictionParameters().turn, TURN_STEPS * sensor.position_resolution)
        pipeline.observer.friction = JointFrictionParameters(known.coulomb.tolist(), known.viscous.tolist(), turn)
