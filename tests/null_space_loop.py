"""The laws of Section 5 in a plain closed loop: exact model and measurement, constant force on the arm."""

from copy import copy

import numpy as np

from saphari_drake.control.null_space.law import Desired, null_space_torque, task_error, task_force
from saphari_drake.control.null_space.parameters import NullSpaceComplianceParameters
from saphari_drake.control.null_space.system import NullSpaceComplianceController
from saphari_drake.estimation.disturbance_observer import (
    DisturbanceObserver,
    DisturbanceObserverParameters,
    advance_estimate,
)
from saphari_drake.estimation.momentum_observer import advance_integral, discrete_gain, residual
from saphari_drake.robots.dynamics import evaluate_dynamics


def bent(seed):
    """Return a random posture away from singularities of the position of the last link."""
    rng = np.random.default_rng(seed)
    spread = [2.0, 0.4, 0.8, 0.3, 1.0, 0.3, 1.0]
    return np.array([0.0, 0.5, 0.0, 1.4, 0.0, 1.0, 0.0]) + rng.uniform(-1.0, 1.0, 7) * spread


class Loop:
    """Steps of one period from rest at home; `sign` −1 gives the printed observer."""

    def __init__(self, robot, observer, q, *, period=0.002, sign=1.0, **params):
        self.robot = robot = copy(robot)
        robot.home = np.array(q)
        self.q, self.v, self.sign = np.array(q), np.zeros(robot.n), sign
        self.params = NullSpaceComplianceParameters(
            observer=observer, period=period, null_stiffness=10.0, null_damping=5.0, **params
        )
        self.controller = NullSpaceComplianceController(robot, self.params)
        gains = DisturbanceObserverParameters(period=period)
        self.Gamma_inv = DisturbanceObserver(robot, gains).Gamma_inv
        self.estimate, self.rest = np.zeros(robot.n), np.array(q)
        self.gain = discrete_gain(np.full(robot.n, 50.0), period)
        self.terms = evaluate_dynamics(robot, self.q, self.v)
        start = self.controller.kinematics(self.terms)
        self.R_d, self.p_d = start.R, start.p
        self.integral = self.terms.p
        self.V_d = self.A_d = np.zeros(6)

    @classmethod
    def pushed(cls, robot, observer, q, seed):
        """Return loops without and with an observer, and a random push of 8 N: force and where it acts."""
        rng = np.random.default_rng(100 + seed)
        F = rng.normal(size=3)
        where = {"link": int(rng.integers(2, 5)), "p_LC": (0.0, 0.06, float(rng.uniform(0.05, 0.15)))}
        return cls(robot, "none", q), cls(robot, observer, q), 8.0 * F / np.linalg.norm(F), where

    def step(self, F_W=None, link=2, p_LC=(0.0, 0.0, 0.12), tau_ext=None):
        """Apply the law and a force on the arm (or its joint torque) over one period; return the task error."""
        self.terms = d = evaluate_dynamics(self.robot, self.q, self.v)
        now, gains = self.controller.kinematics(d), self.controller.gains
        self.task = now.task
        self.e = task_error(now, Desired(self.R_d, self.p_d, self.V_d, self.A_d, self.rest))
        self.tau_ext = -d.point(link, np.array(p_LC)).Jv_WC.T @ F_W if tau_ext is None else tau_ext
        r = residual(d.p, self.integral, self.gain)
        momentum, period = self.params.observer == "momentum", self.params.period
        estimate = -r if momentum else self.estimate
        force = task_force(self.task, self.e, estimate, d.v, gains)
        torque = self.task.J.T @ (force.task + force.compensation) + d.Cv + d.g
        torque += null_space_torque(self.task, self.rest - self.q, d.M, gains)
        self.integral = advance_integral(self.integral, r, torque, d, period)
        self.v = self.v + period * np.linalg.solve(d.M, torque - d.Cv - d.g - self.tau_ext)
        self.q = self.q + period * self.v
        before = self.estimate
        self.estimate = advance_estimate(before, self.sign * force.drive, self.Gamma_inv, period)
        self.before = before
        return float(np.linalg.norm(self.e.error[-3:]))

    def run(self, duration, F_W, **where):
        """Return the task error of each step, and stop early when the arm runs away."""
        errors = []
        for _ in range(round(duration / self.params.period)):
            errors.append(self.step(F_W, **where))
            if not errors[-1] < 1.0 or np.abs(self.v).max() > 100.0:
                errors.append(np.inf)
                break
        return np.array(errors)
