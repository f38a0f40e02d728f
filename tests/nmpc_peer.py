"""The same predictive control problem written for CasADi, solved by IPOPT with default options: peer and reference."""

import casadi as ca
import numpy as np
from nmpc_problems import CASES, DH_ALPHA, DH_D, HOME, MOUNT, OBSTACLES, POINTS, SCALE


class CasadiPeer:
    """Problem of one case, built from the DH table alone; nothing is shared with the library but its numbers."""

    def __init__(self, robot, case, R_ref, horizon=10, period=0.1, options=None):
        cost_on, rows_on = CASES[case]
        n, N = 10, horizon
        q, q0, p_ref = ca.SX.sym("q", n, N), ca.SX.sym("q0", n), ca.SX.sym("p", 3, N)
        Q_v = np.array([0.2] * 3 + [0.05] * 7)
        f, g = 0, []
        v_max = robot.v_max * SCALE
        steps = []
        for k in range(N):
            last = k == N - 1
            step = q[:, k] - (q[:, k - 1] if k else q0)
            steps.append(step)
            f += ca.sum1(Q_v * step**2) / period**2
            frames = self._frames(q[:, k])
            R = frames[-1][:3, :3]
            D = ca.mtimes(R_ref.T, R)
            vee = ca.vertcat(D[2, 1] - D[1, 2], D[0, 2] - D[2, 0], D[1, 0] - D[0, 1])
            e_o = vee / ca.sqrt(1 + ca.trace(D))
            e_p = frames[-1][:3, 3] - p_ref[:, k]
            Q_q, Q_p, Q_o = (0.1, 100.0, 10.0) if last else (0.02, 20.0, 2.0)
            f += Q_q * ca.sumsqr(q[3:, k] - HOME[3:]) + Q_p * ca.sumsqr(e_p) + Q_o * ca.sumsqr(e_o)
            for _, link, offset, d_min, c in POINTS:
                p = ca.mtimes(frames[link], ca.vertcat(*offset, 1.0))[:3]
                for o in OBSTACLES:
                    s = ca.sumsqr(p - o) - d_min**2
                    if cost_on:
                        t = (s - 1e-3) / 1e-3
                        f += (2.0 if last else 1.0) * c * ca.if_else(s >= 1e-3, 1 / s, 1e3 * (1 - t + t * t))
                    if rows_on:
                        g.append(s)
        problem = {"x": ca.vec(q), "p": ca.vertcat(q0, ca.vec(p_ref)), "f": f, "g": ca.vertcat(*steps, *g)}
        quiet = {"ipopt.print_level": 0, "print_time": 0, "ipopt.sb": "yes"}
        self.solver = ca.nlpsol("peer", "ipopt", problem, quiet | (options or {}))
        self.low, self.high = np.tile(robot.q_min, N), np.tile(robot.q_max, N)
        reach = np.tile(period * v_max, N)
        self.g_low = np.concatenate([-reach, np.zeros(len(g))])
        self.g_high = np.concatenate([reach, np.full(len(g), np.inf)])
        self.shape = N, n

    @staticmethod
    def _frames(q):
        c, s = ca.cos(q[2]), ca.sin(q[2])
        X = ca.SX.eye(4)
        X[0, 0], X[0, 1], X[1, 0], X[1, 1], X[0, 3], X[1, 3] = c, -s, s, c, q[0], q[1]
        frames = [X]
        mount = ca.SX.eye(4)
        mount[:3, 3] = MOUNT
        X = ca.mtimes(X, mount)
        for j, (d, alpha) in enumerate(zip(DH_D, DH_ALPHA)):
            c, s, ca_, sa = ca.cos(q[3 + j]), ca.sin(q[3 + j]), round(np.cos(alpha)), round(np.sin(alpha))
            A = ca.SX.eye(4)
            A[0, 0], A[0, 1], A[0, 2] = c, -s * ca_, s * sa
            A[1, 0], A[1, 1], A[1, 2] = s, c * ca_, -c * sa
            A[2, 1], A[2, 2], A[2, 3] = sa, ca_, d
            X = ca.mtimes(X, A)
            frames.append(X)
        return frames

    def solve(self, q0, p_ref, guess):
        """Return the solution (N, n) from a guess, for reference positions (N + 1, 3), and whether it is one."""
        p = np.concatenate([q0, np.asarray(p_ref)[1:].ravel()])
        result = self.solver(x0=guess.ravel(), p=p, lbx=self.low, ubx=self.high, lbg=self.g_low, ubg=self.g_high)
        return np.array(result["x"]).reshape(self.shape), bool(self.solver.stats()["success"])
