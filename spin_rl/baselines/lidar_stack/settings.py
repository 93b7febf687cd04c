"""What the stack can be tuned by; docs/baselines.md has the values beside those of the RE1's own stack."""

from __future__ import annotations

from dataclasses import dataclass, field

from spin_rl import robot


@dataclass(frozen=True)
class MapSettings:
    """The mapping drive, and the map that it makes.

    Attributes:
        cell_m: Side of a cell.
        side_m: Side of the map, whose middle is halfway between start and goal.
        hit: Log-odds that a beam adds where it ends.
        passed: Log-odds that it adds on its way.
        limit: Largest log-odds either way.
        way_m: Way between two scans.
        turn_rad: Largest turn between two scans.
        match_sigma_m: Of the distance of a beam's end to those of earlier scans, in matching.
        match_step_m: First step of matching along x and y.
        match_step_rad: First turn of matching.
        match_halvings: How often they are halved.
        match_beams: Beams that are matched.
        scans_between_plans: The drive's way is planned anew after so many.
        most_scans: The drive ends after so many.
        arrived_m: Distance at which it turns round at the goal.
    """

    cell_m: float = 0.05
    side_m: float = 16.0
    hit: float = 0.9
    passed: float = -0.3
    limit: float = 4.0
    way_m: float = 0.25
    turn_rad: float = 0.5
    match_sigma_m: float = 0.05
    match_step_m: float = 0.05
    match_step_rad: float = 0.05
    match_halvings: int = 5
    match_beams: int = 180
    scans_between_plans: int = 4
    most_scans: int = 240
    arrived_m: float = 0.3


@dataclass(frozen=True)
class LocalizationSettings:
    """Monte Carlo localization.

    Attributes:
        particles: How many.
        update_m: Way after which particles are weighed.
        update_rad: Turn after which they are.
        resample_interval: They are drawn anew after so many weighings.
        beams: Beams that weigh them.
        z_hit: Share of beams that end at the map's obstacles.
        z_rand: Share of those that end anywhere.
        sigma_hit_m: Of the former's distance to the obstacle.
        independence: What a beam's likelihood is raised to: neighbouring beams err alike.
        alphas: Errors of the odometry, as in `sensors.odometry.OdometryConfig`.
        start_error_m: Standard deviation, along x and y, of the error of the start pose that is given.
        start_error_rad: That of its yaw.
        first_updates: Weighings on the spot, at the start.
    """

    particles: int = 500
    update_m: float = 0.1
    update_rad: float = 0.25
    resample_interval: int = 2
    beams: int = 60
    z_hit: float = 0.95
    z_rand: float = 0.05
    sigma_hit_m: float = 0.1
    independence: float = 0.2
    alphas: tuple[float, float, float, float] = (0.2, 0.2, 0.2, 0.2)
    start_error_m: float = 0.1
    start_error_rad: float = 0.1
    first_updates: int = 8


@dataclass(frozen=True)
class PlannerSettings:
    """Ways through the map and what was seen of late.

    Attributes:
        blocked_m: Distance to obstacles below which no way leads.
        near_m: Distance below which a way costs four times its length.
        goal_m: Cells so near to the goal count as at it.
        period_s: The way is planned anew so often, where what is seen has changed.
        oldest_s: And so often everywhere.
        mark_m: Farthest that a beam marks an obstacle.
        clear_m: Farthest that a beam clears one.
        hit: Log-odds that a beam adds where it ends.
        passed: Log-odds that it adds on its way.
        limits: Lowest and highest log-odds.
    """

    blocked_m: float = 0.18
    near_m: float = 0.38
    goal_m: float = 0.1
    period_s: float = 0.5
    oldest_s: float = 5.0
    mark_m: float = 2.5
    clear_m: float = 3.0
    hit: float = 2.0
    passed: float = -1.0
    limits: tuple[float, float] = (-2.0, 4.0)


@dataclass(frozen=True)
class FollowerSettings:
    """The dynamic window.

    Attributes:
        speed: Largest forward speed [m/s].
        turn: Largest turning speed [rad/s].
        speeds: Forward speeds that are tried, shares of the largest.
        turns: How many turning speeds are tried.
        reverse: Backward speed that is tried [m/s].
        time_s: How long a drive is looked at.
        steps: In how many pieces.
        ahead_m: Before the robot the way left counts as well.
        margin_m: Least distance to what the scan shows.
        near_m: Distance from which that costs.
        obstacle_m: How much it costs at most.
        idle_m: What it costs to stand still or to back up, rather than turn or drive forward.
        footprint: Low x and y, high x and y of the stowed robot [m].
    """

    speed: float = 0.6
    turn: float = 1.0
    speeds: tuple[float, ...] = (0.0, 0.15, 0.3, 0.6, 1.0)
    turns: int = 13
    reverse: float = 0.1
    time_s: float = 1.2
    steps: int = 6
    ahead_m: float = 0.3
    margin_m: float = 0.02
    near_m: float = 0.15
    obstacle_m: float = 0.3
    idle_m: float = 2.0
    footprint: tuple[float, float, float, float] = (
        robot.BASE_X_M[0],
        -robot.BASE_HALF_WIDTH_M - 0.009,
        robot.BASE_X_M[1] + 0.006,
        robot.BASE_HALF_WIDTH_M,
    )


@dataclass(frozen=True)
class RecoverySettings:
    """What happens where the robot gets no nearer; each follows the one before.

    Attributes:
        patience_s: Time without progress before the first.
        progress_m: What counts as progress.
        clear_s: Time given after what was seen of late is forgotten.
        rotate_s: Time of turning on the spot.
        back_s: Time of backing up.
    """

    patience_s: float = 4.0
    progress_m: float = 0.1
    clear_s: float = 2.0
    rotate_s: float = 4.0
    back_s: float = 2.0


@dataclass(frozen=True)
class StackSettings:
    """All of the stack.

    Attributes:
        map: Mapping.
        localization: Localization.
        planner: Planning.
        follower: Following.
        recovery: Recovery.
        execution_error: Standard deviation of the base's speeds, a share of the command: floor and slip.
        execution_time_s: How long such an error lasts.
        stow_s: Time to stow the arm in, before the base moves.
        seed: Of all that is drawn.
    """

    map: MapSettings = field(default_factory=MapSettings)
    localization: LocalizationSettings = field(default_factory=LocalizationSettings)
    planner: PlannerSettings = field(default_factory=PlannerSettings)
    follower: FollowerSettings = field(default_factory=FollowerSettings)
    recovery: RecoverySettings = field(default_factory=RecoverySettings)
    execution_error: float = 0.05
    execution_time_s: float = 1.0
    stow_s: float = 2.0
    seed: int = 0
