"""Arms for the tests: the shipped one, two of example-robot-data, a mobile one, and their Pinocchio twins."""

import sysconfig
from pathlib import Path

import numpy as np
import pinocchio as pin
from pydrake.math import RigidTransform, RollPitchYaw

from saphari_drake.robots.catalog import models_dir

EXAMPLES = Path(sysconfig.get_paths()["purelib"]) / "cmeel.prefix" / "share" / "example-robot-data" / "robots"
TILTED = RigidTransform(RollPitchYaw(0.3, -0.5, 0.9), [0.4, -0.2, 0.7])

INERTIAL = """
    <inertial>
      <origin xyz="{com}"/>
      <mass value="{mass}"/>
      <inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/>
    </inertial>"""


def link(name, mass=1.0, com="0.1 0.02 0.05", inertia=0.05, extra=""):
    """Return a URDF link; mass 0 leaves the inertial element out."""
    inertial = INERTIAL.format(com=com, mass=mass, i=inertia) if mass else ""
    return f'<link name="{name}">{inertial}{extra}</link>'


def joint(name, parent, child, kind="revolute", axis="0 0 1", origin="0.1 0 0.2", effort='effort="20"'):
    """Return a URDF joint with generous limits."""
    limit = f'<limit lower="-2" upper="2" velocity="3" {effort}/>'
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{origin}" rpy="0.1 -0.2 0.3"/><axis xyz="{axis}"/>{limit}</joint>'
    )


def write_urdf(folder, *elements, name="small"):
    """Write a URDF of the elements and return its path."""
    path = Path(folder) / f"{name}.urdf"
    path.write_text(f'<?xml version="1.0"?><robot name="{name}">{"".join(elements)}</robot>')
    return path


def write_mobile_arm(folder):
    """Write a platform (prismatic x, y, revolute z) with two links on it; the carriages x and y have no mass."""
    return write_urdf(
        folder,
        link("ground", 0),
        link("carriage_x", 0),
        link("carriage_y", 0),
        link("platform", 30.0, inertia=2.0),
        link("upper", 3.0),
        link("lower", 1.5),
        link("tool", 0.4),
        joint("x", "ground", "carriage_x", "prismatic", "1 0 0"),
        joint("y", "carriage_x", "carriage_y", "prismatic", "0 1 0"),
        joint("theta", "carriage_y", "platform"),
        joint("shoulder", "platform", "upper", axis="0 1 0"),
        joint("elbow", "upper", "lower", axis="0.6 0 0.8"),
        joint("mount", "lower", "tool", "fixed"),
        name="mobile",
    )


def write_random_tree(folder, seed, joints=9):
    """Write a tree that branches anywhere, with revolute and prismatic joints about any axes."""
    rng = np.random.default_rng(seed)
    text = lambda values: " ".join(f"{value:.6f}" for value in values)  # noqa: E731
    elements = [link("link_0", 0)]
    for k in range(1, joints + 1):
        axis, kind = rng.normal(size=3), ("revolute", "prismatic")[rng.random() < 0.3]
        elements.append(link(f"link_{k}", rng.uniform(0.5, 5.0), text(rng.uniform(-0.2, 0.2, 3)), 0.05))
        where = {"axis": text(axis / np.linalg.norm(axis)), "origin": text(rng.uniform(-0.4, 0.4, 3))}
        elements.append(joint(f"joint_{k}", f"link_{rng.integers(max(k - 3, 0), k)}", f"link_{k}", kind, **where))
    return write_urdf(folder, *elements, name=f"tree_{seed}")


def arm_path(name, folder):
    """Return the model file of one of `ARMS`."""
    return {
        "lwr4": models_dir() / "lwr4" / "lwr4.urdf",
        "panda": EXAMPLES / "panda_description" / "urdf" / "panda.urdf",
        "xarm7": EXAMPLES / "xarm_description" / "urdf" / "xarm7.urdf",
    }.get(name) or write_mobile_arm(folder)


ARMS = ("lwr4", "panda", "xarm7", "mobile")
FIXED = ("xarm7",)  # welded to the world by its own file


def states(robot, count, seed=0):
    """Return random positions (within ±2) and velocities (within ±1)."""
    rng = np.random.default_rng(seed)
    return zip(rng.uniform(-2.0, 2.0, (count, robot.n)), rng.uniform(-1.0, 1.0, (count, robot.n)), strict=True)


# kg m², reflected inertia of the motors as in the files.
MOTORS = {"lwr4": dict(zip((f"joint_{k}" for k in range(1, 8)), (0.1, 0.1, 0.1, 0.1, 0.05, 0.05, 0.02)))}


class PinocchioTwin:
    """The same file read and evaluated by Pinocchio, in the joint order of a `RobotModel`; the others stay at 0."""

    def __init__(self, robot):
        self.X_WB = robot.X_WB
        whole = pin.buildModelFromUrdf(str(robot.path))
        held = [whole.getJointId(name) for name in whole.names[1:] if name not in robot.joint_names]
        self.model = pin.buildReducedModel(whole, held, pin.neutral(whole))
        R_BW = robot.X_WB.rotation().inverse().matrix()
        self.model.gravity.linear = R_BW @ np.array([0.0, 0.0, -9.81])
        self.order = np.array([self.model.joints[self.model.getJointId(n)].idx_v for n in robot.joint_names])
        armature = np.zeros(self.model.nv)
        armature[self.order] = [MOTORS.get(robot.name, {}).get(name, 0.0) for name in robot.joint_names]
        self.model.armature = armature  # Drake's tags, which Pinocchio does not read
        self.data = self.model.createData()
        self.joints = [self.model.getJointId(name) for name in robot.joint_names]

    def dynamics(self, q, v):
        """Return M, Cv, CTv and g."""
        q, v = self._own(q), self._own(v)
        zero = np.zeros_like(q)
        M = pin.crba(self.model, self.data, q)
        M = np.triu(M) + np.triu(M, 1).T
        C = pin.computeCoriolisMatrix(self.model, self.data, q, v).copy()
        g = pin.rnea(self.model, self.data, q, zero, zero).copy()
        Cv = pin.rnea(self.model, self.data, q, v, zero) - g
        o = self.order
        return M[np.ix_(o, o)], Cv[o], (C.T @ v)[o], g[o]

    def coriolis(self, q, v):
        """Return a C with C q̇ the bias and C + Cᵀ the time derivative of M."""
        C = pin.computeCoriolisMatrix(self.model, self.data, self._own(q), self._own(v))
        return C[np.ix_(self.order, self.order)].copy()

    def point(self, q, v, link, p_LC):
        """Return p_WC, v_WC, Jv_WC and J̇q̇ of a point of a link."""
        q, v = self._own(q), self._own(v)
        frame = pin.Frame("C", self.joints[link], 0, pin.SE3(np.eye(3), p_LC), pin.FrameType.OP_FRAME)
        model = self.model.copy()
        index = model.addFrame(frame)
        data = model.createData()
        aligned = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        pin.forwardKinematics(model, data, q, v, np.zeros_like(q))
        pin.updateFramePlacements(model, data)
        J = pin.computeFrameJacobian(model, data, q, index, aligned)[:3, self.order]
        # Kinematics once more: the Jacobian's call has overwritten velocities and accelerations.
        pin.forwardKinematics(model, data, q, v, np.zeros_like(q))
        pin.updateFramePlacements(model, data)
        R = self.X_WB.rotation().matrix()
        return (
            self.X_WB @ data.oMf[index].translation,
            R @ pin.getFrameVelocity(model, data, index, aligned).linear,
            R @ J,
            R @ pin.getFrameClassicalAcceleration(model, data, index, aligned).linear,
        )

    def _own(self, values):
        own = np.empty_like(values)
        own[self.order] = values
        return own
