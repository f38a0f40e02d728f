"""What is known of encoders and friction reaches the observer."""

import numpy as np
from experiments.contact.known import adapt_to_encoders, adapt_to_friction

from saphari_drake.pipelines.contact import ContactPipelineParameters
from saphari_drake.simulation.sensors.joint_sensor import JointSensorParameters


def test_coarse_encoders_are_averaged_and_fine_ones_are_not(lwr4):
    found = []
    for resolution in (1e-5, 2.0 * np.pi / 2**16):
        pipeline = ContactPipelineParameters()
        adapt_to_encoders(pipeline, lwr4, JointSensorParameters(position_resolution=resolution))
        found.append(pipeline.observer.averaged)
    assert found[0] == 1 < found[1]


def test_friction_turns_round_over_ten_steps_of_coarse_encoders():
    pipeline = ContactPipelineParameters()
    adapt_to_friction(pipeline, JointSensorParameters())
    assert pipeline.observer.friction.turn == 1e-4
    adapt_to_friction(pipeline, JointSensorParameters(position_resolution=2e-4))
    assert pipeline.observer.friction.turn == 2e-3
