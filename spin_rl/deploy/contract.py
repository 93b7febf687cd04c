"""What an exported policy reads, what its actions mean and how it is to be run: the metadata of its file.

`spin_rl.export` writes it, the runtime reads it and knows nothing of the policy beside; see `metadata`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from spin_rl import robot
from spin_rl.config import POSITIVE, Choice, Length, Range, Text
from spin_rl.deploy.pilot.settings import NUM_HULLS, Guard, Planner, Shape
from spin_rl.sensors.depth.filter_config import DepthFilterConfig

FORMAT = 1
ABSOLUTE, INCREMENTS = "absolute", "increments"
STATE = {"h_in": "h_out", "c_in": "c_out"}
"""Inputs that hold the policy's memory, each with the output that is its value in the next step."""
ACTION_OUTPUT = "actions"
UINT8, FLOAT32 = "uint8", "float32"

Mount = Annotated[robot.CameraMount, Choice(("portrait", "landscape"))]
Positive = Annotated[float, POSITIVE]
Count = Annotated[int, Range(1)]
PerJoint = Annotated[tuple[float, ...], Length(len(robot.JOINTS), len(robot.JOINTS))]


@dataclass(frozen=True)
class Term:
    """Some columns of an observation group: `clip(raw * scale + bias)`.

    Attributes:
        name: What it is, a key of `observations.TERMS`.
        labels: Of each column.
        unit: Of the raw values.
        scale: Of each column.
        bias: Of each column.
        clip: Largest size of the scaled values; None for any.
    """

    name: str
    labels: tuple[str, ...]
    unit: str
    scale: tuple[float, ...]
    bias: tuple[float, ...]
    clip: float | None = None

    def __post_init__(self) -> None:
        """Reject columns that do not fit each other."""
        if not len(self.labels) == len(self.scale) == len(self.bias) > 0:
            raise ValueError(f"observations: {self.name} needs a scale and a bias for each of its labels")


@dataclass(frozen=True)
class Group:
    """An input of the network, shape (1, size).

    Attributes:
        name: Name of the input.
        dtype: "float32", or "uint8" for images.
        size: Its columns.
        source: What a robot needs to tell it: "robot" (joints, odometry, goal), "camera", "detector", or
            "simulation" for what only a simulator knows.
        terms: Its columns in order; empty for images and for what only a simulator knows.
    """

    name: str
    dtype: Annotated[str, Choice((UINT8, FLOAT32))]
    size: Count
    source: Annotated[str, Choice(("robot", "camera", "detector", "simulation"))]
    terms: tuple[Term, ...] = ()

    def __post_init__(self) -> None:
        """Reject terms of another size."""
        width = sum(len(term.labels) for term in self.terms)
        if self.terms and width != self.size:
            raise ValueError(f"observations: {self.name} has {self.size} columns and terms for {width}")


@dataclass(frozen=True)
class Actions:
    """What actions from -1 to 1 mean.

    Attributes:
        mode: "absolute": a joint's target is `zero` at 0, `low` at -1 and `high` at 1, linear in between.
            "increments": an action of 1 moves the target by `joint_rate`, and the fingers' target is
            `gripper_middle` and `gripper_span` times the action.
        forward: Base speed at 1, and, a positive number, at -1 [m/s].
        turn: Turning speed at 1 [rad/s].
        low: Lower joint limits in the order of the joints [m, rad].
        zero: Targets at 0.
        high: Upper joint limits.
        joint_rate: Of increments [m/s, rad/s]; empty otherwise.
        joint_lead: Increments keep the targets within this of where the joints are [m, rad].
        gripper_middle: See `mode` [rad].
        gripper_span: See `mode` [rad].
    """

    mode: Annotated[str, Choice((ABSOLUTE, INCREMENTS))]
    forward: tuple[float, float]
    turn: float
    low: PerJoint
    zero: PerJoint
    high: PerJoint
    joint_rate: tuple[float, ...] = ()
    joint_lead: tuple[float, ...] = ()
    gripper_middle: float = 0.0
    gripper_span: float = 0.0

    def __post_init__(self) -> None:
        """Reject increments without their sizes."""
        if self.mode == INCREMENTS and not len(self.joint_rate) == len(self.joint_lead) == len(robot.JOINTS):
            raise ValueError("actions.joint_rate, actions.joint_lead: increments need both, for every joint")


@dataclass(frozen=True)
class Camera:
    """The depth camera of the training.

    Attributes:
        mount: "portrait": the camera's own image lies on its side, its right edge down. "landscape": upright.
        fov_deg: Field of view of the upright image, up and down, and across.
        image: Rows and columns of the upright image that the policy or its pilot reads; None if none does.
        focal_px: Focal lengths of that image along rows and columns [pixels].
        range_m: Depths that the policy sees as 0 and 255; holes read 255.
        pose: Head pan and tilt [rad] at which it was frozen; None where the policy moves it.
    """

    mount: Mount
    fov_deg: tuple[float, float]
    image: tuple[Count, Count] | None = None
    focal_px: tuple[Positive, Positive] | None = None
    range_m: tuple[float, float] | None = None
    pose: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        """Reject an image without its focal lengths."""
        if (self.image is None) != (self.focal_px is None):
            raise ValueError("camera.image, camera.focal_px: one needs the other")


@dataclass(frozen=True)
class Scandots:
    """Which corners of obstacles a simulator tells; see `tasks.common.config.ScandotsConfig`."""

    window_m: Positive
    near_m: Positive
    occlusion: bool
    pieces_from_m: Positive | None = None


@dataclass(frozen=True)
class Goal:
    """How goals are told.

    Attributes:
        range_m: A goal farther away is told as this far, in its direction; None: where it is.
        tolerance_m: Distance at which it is reached.
    """

    range_m: Positive | None
    tolerance_m: Positive


@dataclass(frozen=True)
class Profile:
    """How fast the robot of the training moved; see `robot.SpeedProfile`."""

    name: str
    forward_max: Positive
    reverse_max: Positive
    turn_max: Positive
    base_acceleration: Positive
    turn_acceleration: Positive
    joint_velocity_max: PerJoint
    joint_time_constant: Positive
    base_time_constant: Positive


@dataclass(frozen=True)
class Memory:
    """An input that holds memory: the output that is its next value, its shape, its value after a reset."""

    next: str
    shape: tuple[Count, ...]
    initial: float


@dataclass(frozen=True)
class Parity:
    """The check against the trained policy: steps, resets in them, largest errors of actions and memory."""

    steps: int
    resets: int
    action_error: float
    state_error: float


@dataclass(frozen=True)
class Contract:
    """Metadata of an exported policy; the names of mjlab and Isaac Lab where they have one.

    Attributes:
        format: Version of this metadata.
        program: Version and commit of the program that exported it.
        name: Name of the policy.
        task: The task that it was trained in.
        observation_names: Names of the inputs beside the memory, in their order.
        observations: These inputs.
        action_names: Names of the actions, in their order.
        actions: What they mean.
        joint_names: Names of the joints, in their order.
        default_joint_pos: Their stowed pose [m, rad].
        rate_hz: Control steps a second.
        camera: The depth camera.
        depth_filter: Filter of its images, see `DepthFilterConfig`; None without images.
        scandots: Which corners of obstacles are told; None for a policy that is told none.
        goal: How goals are told; None for a policy without.
        speed_profile: How fast the robot was.
        state: The inputs that hold memory, by name.
        reset: When the memory is reset, and what is the last action then.
        simulation_only: Why a real robot cannot run it; None where one can.
        training: How it was trained: command, hardware, samples and ranges of the dynamics.
        parity: The check at the export; None before it.
        model_card: What was measured, as text.
        guard: What the base is guarded with; None for policies of other tasks than driving.
        planner: What plans its ways; likewise.
        shapes: The robot's collision geoms, where guard or planner are on.
    """

    format: int
    program: str
    name: str
    task: str
    observation_names: tuple[str, ...]
    observations: tuple[Group, ...]
    action_names: tuple[str, ...]
    actions: Actions
    joint_names: tuple[str, ...]
    default_joint_pos: PerJoint
    rate_hz: Positive
    camera: Camera
    depth_filter: DepthFilterConfig | None
    scandots: Scandots | None
    goal: Goal | None
    speed_profile: Profile
    state: dict[str, Memory]
    reset: str
    simulation_only: str | None
    training: dict
    parity: Parity | None
    model_card: Annotated[str, Text()]
    guard: Guard | None
    planner: Planner | None
    shapes: tuple[Shape, ...]

    def __post_init__(self) -> None:
        """Reject what does not fit this program or itself."""
        if self.joint_names != robot.JOINTS or self.action_names != robot.ACTIONS:
            raise ValueError("joint_names, action_names: not those of this program's robot")
        if self.observation_names != tuple(group.name for group in self.observations):
            raise ValueError("observation_names: not those of observations")
        image = self.camera.image
        for group in self.observations:
            is_whole = image is not None and group.size == image[0] * image[1]
            if group.source == "camera" and not (is_whole and self.depth_filter is not None):
                raise ValueError(f"observations: {group.name} needs depth_filter and a camera.image as large")
        if self.has_pilot and not (self.shapes and self.goal is not None and self.camera.image is not None):
            raise ValueError("guard, planner: need shapes, a goal and the size of the camera's image")
        if self.has_planner and not self.has_pilot:
            raise ValueError("planner: needs the guard")
        if self.has_pilot and len({shape.hull for shape in self.shapes}) != NUM_HULLS:
            raise ValueError(f"shapes: need one of each hull, 0 to {NUM_HULLS - 1}")

    @property
    def has_pilot(self) -> bool:
        """Whether it drives behind a guard, with or without a planner."""
        return self.guard is not None and self.guard.enabled

    @property
    def has_planner(self) -> bool:
        """Whether it drives by the ways of a planner."""
        return self.planner is not None and self.planner.enabled

    @property
    def period_s(self) -> float:
        """Time between two control steps [s]."""
        return 1.0 / self.rate_hz

    @property
    def sources(self) -> frozenset[str]:
        """Of all its groups, see `Group.source`."""
        return frozenset(group.source for group in self.observations)
