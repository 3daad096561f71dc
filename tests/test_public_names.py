"""The public face: names, and what importing them costs."""

import ast
import importlib
import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

import bodyimage_kin as bk

NAMES = (
    "BodyImage", "Camera", "Drag", "Embodiment", "Hand", "Kinematics", "Noise", "Pinhole", "Robot", "Stereo", "Study",
    "Tracker", "VirtualScreen", "backends", "body_image", "embodiments", "errors", "estimators", "experience",
    "figures", "integrate", "kinematics", "load_embodiment", "load_learned", "metrics", "motions", "probes",
    "published", "read_recording", "recordings", "report", "simulate", "study", "testing", "write_recording",
)  # fmt: skip
METHODS = {
    "Robot": "from_urdf from_dh geometry notes name root link_names joint_names"
    "  lower upper sample subtree to_urdf sha256",
    "RobotKinematics": "pose jacobian pose_and_jacobian hessian",
    "Embodiment": "robot joints hand camera skin home visible"
    "  touch_postures full_posture hand_image hand_image_jacobian",
    "motions": "Circle FaceTour Motion Path RandomTouch",
    "BodyImage": "learn",
    "metrics": "jacobian_errors attribute excitation motion_metric depth_ratio",
    "probes": "Probe Training Face JointSpace",
    "published": "ambiguities foreknowledge fuke2007",
    "testing": "LAWS cases robots oracle",
    "study": "Study",
    "estimators": "names LeastSquares PaperMLP Analytic",
}


HEAVY = {
    *("torch", "pinocchio", "pytorch_kinematics", "numba", "mujoco", "xarray", "matplotlib", "scipy", "numpy"),
    *("hypothesis", "pandas", "h5py", "trimesh", "yourdfpy"),
}


def loaded_by(code):
    """Names of the modules that are loaded once a fresh interpreter has run this."""
    program = f"import sys\n{code}\nprint('\\n'.join(sys.modules))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    return set(done.stdout.split())


def test_every_public_name_is_there():
    assert set(NAMES) <= set(bk.__all__)
    assert len(bk.__all__) == len(set(bk.__all__))
    assert dir(bk) == sorted(bk.__all__)
    for name in bk.__all__:
        assert getattr(bk, name) is not None


def test_type_checkers_are_told_the_same_names():
    tree = ast.parse(Path(bk.__file__).read_text(encoding="utf-8"))
    told = next(node for node in tree.body if isinstance(node, ast.If) and node.test.id == "TYPE_CHECKING")
    names = [alias.asname for node in told.body for alias in node.names]
    assert len(names) == len(set(names))
    assert {*names, "__version__"} == set(bk.__all__)
    for node in told.body:
        for alias in node.names:
            # The same object, and not another of the same name.
            assert alias.name == alias.asname
            found = importlib.import_module(node.module)
            if node.module != "bodyimage_kin":
                assert getattr(bk, alias.name) in (found, getattr(found, alias.name))


def test_a_room_is_there_before_anything_of_it_was_used():
    loaded_by(
        "import bodyimage_kin as bk\n"
        "assert bk.study.Study is bk.Study\n"
        "assert bk.probes.Face is bk.metrics.probes.Face\n"
        "assert {'study', 'published', 'testing'} <= set(dir(bk))"
    )


@pytest.mark.parametrize("owner", METHODS)
def test_what_the_contract_promises_is_there(owner):
    promised = getattr(bk, owner)
    fields = set(getattr(promised, "__dataclass_fields__", ()))
    missing = [name for name in METHODS[owner].split() if not hasattr(promised, name) and name not in fields]
    assert not missing


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        _ = bk.nothing


def test_backends_is_a_module_that_can_be_called():
    assert bk.backends is importlib.import_module("bodyimage_kin.backends")
    known = bk.backends()
    assert {"pinocchio", "pytorch_kinematics"} <= set(known)
    assert all(state == "installed" or state.startswith("pip install ") for state in known.values())


@pytest.mark.parametrize("module", ["bodyimage_kin", "bodyimage_kin.errors", "bodyimage_kin.cli"])
def test_importing_it_does_not_import_what_is_heavy(module):
    if importlib.util.find_spec(module) is None:
        pytest.skip(f"there is no {module} yet")
    assert not HEAVY & loaded_by(f"import {module}")


@pytest.mark.parametrize("arguments", [["--help"], ["study", "--help"], ["conform", "--help"]])
def test_help_answers_at_once(arguments):
    code = f"from bodyimage_kin.cli import main\ntry:\n    main({arguments})\n"
    assert not HEAVY & loaded_by(f"{code}except SystemExit as end:\n    assert not end.code")


def test_reading_a_robot_does_not_import_a_library_of_kinematics():
    loaded = loaded_by('import bodyimage_kin as bk; bk.Robot.from_urdf(\'<robot name="r"><link name="a"/></robot>\')')
    assert not {"pinocchio", "pytorch_kinematics", "numba", "mujoco"} & loaded


def test_every_error_is_one_of_ours():
    errors = [
        value
        for value in vars(bk.errors).values()
        if isinstance(value, type) and value.__module__ == bk.errors.__name__
    ]
    assert all(issubclass(error, bk.BodyImageKinError | Warning) for error in errors)
    assert {error.__name__ for error in errors} == set(bk.errors.__all__)
    error = bk.errors.UnknownName("link", "hnad", ["hand", "torso"])
    assert str(error) == "no link 'hnad'; did you mean 'hand'? valid: hand, torso"
    assert (error.kind, error.name, error.valid) == ("link", "hnad", ("hand", "torso"))
