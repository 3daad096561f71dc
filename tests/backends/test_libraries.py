"""What the libraries underneath get wrong, and what is done about it.

A test that fails here says that a library has been mended: remove the workaround that its comment names.
"""

import subprocess
import sys
import textwrap

import numpy as np
import pinocchio as pin
import pytest
import pytorch_kinematics
import torch
from robots import ONE_JOINT, STATUE, central, infant, tricky

import bodyimage_kin as bk

ALIGNED = pin.LOCAL_WORLD_ALIGNED


def in_a_process_of_its_own(code):
    """Exit status; negative for a crash."""
    program = f"import pinocchio as pin\nSTATUE, DOOR = '''{STATUE}''', '''{ONE_JOINT}'''\n" + textwrap.dedent(code)
    return subprocess.run([sys.executable, "-c", program], capture_output=True, timeout=60, check=False).returncode


# Pinocchio, against the whole robot and not the chains that the backend builds ---------------------------------------


@pytest.mark.parametrize("reference", ["local_world_aligned", "local", "world"])
def test_pinocchio_itself_gives_these_jacobians(reference):
    robot = infant()
    kin = bk.kinematics(robot, "pinocchio")
    model = pin.buildModelFromXML(robot.to_urdf())
    data = model.createData()
    joints = [model.joints[model.getJointId(name)] for name in robot.joint_names]
    assert all(joint.nq == 1 for joint in joints)
    frame = {"local_world_aligned": ALIGNED, "local": pin.LOCAL, "world": pin.WORLD}[reference]
    for q in robot.sample(4, seed=2):
        configuration = np.zeros(model.nq)
        configuration[[joint.idx_q for joint in joints]] = q.numpy()
        pin.computeJointJacobians(model, data, configuration)
        pin.updateFramePlacements(model, data)
        for link in robot.link_names:
            place = model.getFrameId(link, pin.BODY)
            jacobian = pin.getFrameJacobian(model, data, place, frame)[:, [joint.idx_v for joint in joints]]
            np.testing.assert_allclose(kin.jacobian(q, link, reference).numpy(), jacobian, atol=1e-14)
            np.testing.assert_allclose(kin.pose(q, link).numpy(), data.oMf[place].homogeneous, atol=1e-14)


@pytest.mark.parametrize("robot", [infant, lambda: tricky().unfolded])
def test_pinocchios_own_hessian_is_the_shared_one(robot):
    robot = robot()
    kin = bk.kinematics(robot, "pinocchio")
    model = pin.buildModelFromXML(robot.to_urdf())
    data = model.createData()
    joints = [model.joints[model.getJointId(name)] for name in robot.joint_names]
    columns = [joint.idx_v for joint in joints]
    for q in robot.sample(3, seed=1):
        configuration = np.zeros(model.nq)
        for joint, value in zip(joints, q.tolist(), strict=True):
            configuration[joint.idx_q : joint.idx_q + joint.nq] = (
                [value] if joint.nq == 1 else [np.cos(value), np.sin(value)]
            )
        pin.computeJointJacobians(model, data, configuration)
        pin.updateFramePlacements(model, data)
        pin.computeJointKinematicHessians(model, data, configuration)
        for link in robot.link_names:
            raw = pin.getFrameKinematicHessian(model, data, model.getFrameId(link, pin.BODY), ALIGNED)
            # In the wrong memory order, see below.
            own = np.asarray(raw).ravel().reshape(raw.shape, order="F")[:, columns][:, :, columns]
            np.testing.assert_allclose(kin.hessian(q, link).numpy(), own, atol=1e-14)


def test_pinocchio_sorts_sibling_joints():
    # Why joints are mapped by name, and why the backend's chains bear numbers for names.
    names = list(pin.buildModelFromXML(tricky().to_urdf()).names)[1:]
    assert names.index("alpha") < names.index("zulu")
    assert tricky().joint_names.index("alpha") > tricky().joint_names.index("zulu")


def test_pinocchio_holds_a_continuous_joint_as_two_numbers():
    model = pin.buildModelFromXML(tricky().to_urdf())
    joint = model.joints[model.getJointId("zulu")]
    assert (joint.nq, joint.nv) == (2, 1)


def test_pinocchio_leaves_followers_free():
    # Why followers are set free and folded by shared code.
    assert pin.buildModelFromXML(tricky().to_urdf()).nv == tricky().unfolded.n
    with pytest.raises((RuntimeError, ValueError, IndexError)):
        pin.buildModelFromXML(tricky().to_urdf(), mimic=True)


def test_pinocchio_hands_over_its_hessian_in_the_wrong_memory_order():
    # Workaround in the test above.
    robot = tricky().subtree(["universe"])
    kin = bk.kinematics(robot, "pinocchio")
    q = robot.sample((), seed=1)
    expected = central(lambda x: kin.jacobian(x, "universe"), q).numpy()
    model = pin.buildModelFromXML(robot.to_urdf())
    data = model.createData()
    configuration = np.array([q[0].cos(), q[0].sin(), q[1], q[2]])
    pin.computeJointJacobians(model, data, configuration)
    pin.computeJointKinematicHessians(model, data, configuration)
    place = model.getFrameId("universe", pin.BODY)
    raw = np.asarray(pin.getFrameKinematicHessian(model, data, place, ALIGNED))
    assert np.abs(raw - expected).max() > 0.1
    np.testing.assert_allclose(raw.ravel().reshape(raw.shape, order="F"), expected, atol=1e-9)


def test_pinocchio_gives_one_column_as_a_vector():
    # Workaround in the Pinocchio chain: reshape to (6, nv).
    model = pin.buildModelFromXML(ONE_JOINT)
    data = model.createData()
    pin.computeJointJacobians(model, data, np.zeros(1))
    pin.updateFramePlacements(model, data)
    assert pin.getFrameJacobian(model, data, model.getFrameId("leaf", pin.BODY), ALIGNED).shape == (6,)


def test_pinocchio_crashes_on_the_jacobian_of_a_statue():
    # Workaround in the Pinocchio chain: it is never asked where nothing moves.
    prepare = """
        import numpy
        model = pin.buildModelFromXML(STATUE)
        data = model.createData()
        pin.computeJointJacobians(model, data, numpy.zeros(0))
        place = pin.updateFramePlacement(model, data, model.getFrameId("head", pin.BODY))
    """
    assert in_a_process_of_its_own(prepare) == 0
    ask = '    pin.getFrameJacobian(model, data, model.getFrameId("head", pin.BODY), pin.LOCAL_WORLD_ALIGNED)\n'
    assert in_a_process_of_its_own(textwrap.dedent(prepare) + textwrap.dedent(ask)) != 0


def test_pinocchio_does_not_refuse_an_unknown_frame():
    # Why names are checked before a backend hears of them: it reads beyond its memory, which mostly, but not always,
    # ends the interpreter. An exception, status 1, would mean that it checks the frame itself by now.
    status = in_a_process_of_its_own("""
        model = pin.buildModelFromXML(DOOR)
        pin.updateFramePlacement(model, model.createData(), model.getFrameId("no such frame"))
    """)
    assert status != 1


# pytorch-kinematics ---------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def chain():
    arm = infant().subtree(["left_hand"])
    built = pytorch_kinematics.build_chain_from_urdf(arm.to_urdf().encode()).to(dtype=torch.float64)
    return arm, pytorch_kinematics.SerialChain(built, "left_hand", dtype=torch.float64)


def test_pytorch_kinematics_is_not_exact_by_itself():
    # Workaround in the backend: offsets and axes are overwritten with float64 numbers.
    robot = tricky().subtree(["universe"])
    built = pytorch_kinematics.build_chain_from_urdf(robot.to_urdf().encode()).to(dtype=torch.float64)
    itself = pytorch_kinematics.SerialChain(built, "universe", dtype=torch.float64)
    q = robot.sample(3)
    pose = bk.kinematics(robot, "pinocchio").pose(q, "universe")
    difference = (itself.forward_kinematics(q).get_matrix() - pose).abs().max()
    assert 1e-9 < difference < 1e-5


def test_pytorch_kinematics_has_wrong_second_derivatives(chain):
    # Why all derivatives come from shared code.
    arm, itself = chain
    q = arm.sample((), seed=1)
    hessian = torch.autograd.functional.hessian(lambda x: itself.forward_kinematics(x[None]).get_matrix()[0, 0, 3], q)
    true = bk.kinematics(arm, "pinocchio").hessian(q, "left_hand")[0]
    assert (hessian - true).abs().max() > 1e-3


def test_pytorch_kinematics_broadcasts_a_posture_of_one_value(chain):
    # Why shapes are checked before a backend hears of them.
    arm, itself = chain
    one = itself.jacobian_tensor(torch.full((2, 1), 0.3, dtype=torch.float64))
    every = itself.jacobian_tensor(torch.full((2, arm.n), 0.3, dtype=torch.float64))
    assert torch.equal(one, every)


def test_pytorch_kinematics_cannot_build_a_robot_of_one_link():
    # Workaround in the backend: it is not asked for the root.
    with pytest.raises(UnboundLocalError):
        pytorch_kinematics.build_chain_from_urdf(b'<robot name="stone"><link name="stone"/></robot>')
