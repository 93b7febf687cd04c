"""A live view in the browser with viser: worlds in real time, with choosers and episode statistics.

The robot that is followed stays at the origin and its world moves: cameras belong to those who look, and the
server learns late where they are.
"""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from spin_rl.config import ConfigError
from spin_rl.extras import require
from spin_rl.scenes.kinds import DIFFICULTIES, SCENARIOS
from spin_rl.viewer import style
from spin_rl.viewer.browser.guard import own_pages_only
from spin_rl.viewer.browser.scene import WorldView
from spin_rl.viewer.labels import progress_label, target_label
from spin_rl.viewer.picture import camera_label, camera_picture
from spin_rl.viewer.rollout import Player
from spin_rl.viewer.snapshot import Snapshot
from spin_rl.viewer.stage import Stage, stage_of

OpenPlayer = Callable[[str], Player]
"""Opens a policy by name, at the start of the first episodes."""

_SPACING_M = 6.5
_DEPTH_ROWS = 174
_SECTION_M = 1.0  # of the floor's pattern
_CAMERA_POSITION = (-2.3, -1.5, 2.6)  # from behind and the right of a start pose
_SPEEDS = ("0.25x", "0.5x", "1x", "2x", "4x")


class Browser:
    """The server and its panel."""

    def __init__(self, host: str, port: int) -> None:
        """Start the server.

        Args:
            host: Address to listen on.
            port: Port to listen on.

        Raises:
            ConfigError: viser is missing, the address is none, or the port is taken.
        """
        viser = require("viser", "viser", "viewer", "viewer")
        _check_port(host, port)  # viser would take the next free port without a word
        with own_pages_only(host):
            self.server = viser.ViserServer(host=host, port=port, label="spin-play", verbose=False)
        self.url = f"http://{'localhost' if host in ('127.0.0.1', '0.0.0.0') else host}:{port}"
        self._reset = threading.Event()
        self._stage: Stage | None = None
        self._views: list[WorldView] = []
        self._choosers: dict[int, tuple[tuple[str, ...], str]] = {}
        self._anchor = np.zeros(2)  # what is shown at the origin
        server = self.server
        server.gui.configure_theme(show_logo=False, show_share_button=False)
        server.gui.main_panel.dock_right()
        server.scene.set_up_direction("+z")
        self._floor = server.scene.add_grid(
            "/floor",
            infinite_grid=True,
            cell_size=0.5,
            section_size=_SECTION_M,
            plane_color=style.FLOOR,
            plane_opacity=1.0,
            cell_color=(198, 202, 206),
            section_color=(180, 185, 190),
        )
        server.initial_camera.position = _CAMERA_POSITION
        server.initial_camera.look_at = (0.0, 0.0, 0.5)

    def __enter__(self) -> Browser:
        """Return itself."""
        return self

    def __exit__(self, *exception: object) -> None:
        """Stop the server."""
        self.server.stop()

    def build(
        self, player: Player, policies: Sequence[str], scenario: int, difficulty: int, policy: str
    ) -> None:
        """Add the panel, and the worlds of the first player.

        Args:
            player: The first player.
            policies: Names to choose from.
            scenario: Chosen at first.
            difficulty: Index into `DIFFICULTIES`, chosen at first.
            policy: Chosen at first.
        """
        gui = self.server.gui
        self._status = gui.add_markdown("")
        self._pause = gui.add_checkbox("pause", False)
        gui.add_button("reset", hint="Start new episodes").on_click(lambda _: self._reset.set())
        self._speed = gui.add_dropdown("speed", _SPEEDS, initial_value="1x")
        self._policy = gui.add_dropdown("policy", list(policies), initial_value=policy)
        has_corridors = player.snapshots[0].scandots is not None
        self._scenario = gui.add_dropdown(
            "scenario",
            [str(s) for s in SCENARIOS],
            initial_value=str(scenario),
            hint="1 straight, 2 L-shaped",
            visible=has_corridors,
        )
        self._difficulty = gui.add_dropdown(
            "difficulty", DIFFICULTIES, initial_value=DIFFICULTIES[difficulty], visible=has_corridors
        )
        self._follow = gui.add_checkbox("follow the robot", True)
        worlds = [str(i + 1) for i in range(player.env.num_envs)]
        self._world = gui.add_dropdown("world", worlds, initial_value="1", visible=len(worlds) > 1)
        self._depth = gui.add_image(np.zeros((8, 8, 3), np.uint8), label="depth camera; near is bright")
        self._statistics = gui.add_markdown("")
        choosers = (self._speed, self._policy, self._scenario, self._difficulty, self._world)
        self._choosers = {id(chooser): (tuple(chooser.options), chooser.value) for chooser in choosers}
        self._add_worlds(player)
        self.show(player.snapshots, player)

    def run(
        self,
        open_player: OpenPlayer,
        policies: Sequence[str],
        scenario: int,
        difficulty: int,
        *,
        max_seconds: float | None = None,
    ) -> None:
        """Play until Ctrl-C.

        Args:
            open_player: Opens one of `policies`.
            policies: Names to choose from; the first one plays first.
            scenario: Chosen at first.
            difficulty: Index into `DIFFICULTIES`, chosen at first.
            max_seconds: Stop by itself after this time.
        """
        player = open_player(policies[0])
        self.build(player, policies, scenario, difficulty, policies[0])
        print(f"Open {self.url} in a browser; Ctrl-C stops", flush=True)
        chosen = self._choice()
        end = None if max_seconds is None else time.monotonic() + max_seconds
        with contextlib.suppress(KeyboardInterrupt):
            while end is None or time.monotonic() < end:
                begin = time.monotonic()
                if self._choice() != chosen:
                    player = self._change(player, open_player, chosen)
                    chosen = self._choice()
                elif self._reset.is_set():
                    self._reset.clear()
                    self.show(player.start(*self._cell()), player)
                elif self._pause.value:
                    time.sleep(0.05)
                    continue
                else:
                    self.show(player.step(), player)
                period = player.env.cfg.sim.control_period / float(self._offered(self._speed).rstrip("x"))
                time.sleep(max(0.0, begin + period - time.monotonic()))

    def _offered(self, chooser: Any) -> str:
        """Return what is chosen; what was never offered, but sent, gives way to the last choice."""
        value, (options, last) = chooser.value, self._choosers[id(chooser)]
        if value not in options:
            chooser.value = value = last
        self._choosers[id(chooser)] = options, value
        return value

    def _choice(self) -> tuple[str, str, str]:
        return self._offered(self._policy), self._offered(self._scenario), self._offered(self._difficulty)

    def _cell(self) -> tuple[int, int]:
        return int(self._offered(self._scenario)), DIFFICULTIES.index(self._offered(self._difficulty))

    def _change(self, player: Player, open_player: OpenPlayer, before: tuple[str, str, str]) -> Player:
        """Start what was chosen; a policy that cannot be opened leaves the old one playing."""
        name = self._offered(self._policy)
        if name != before[0]:
            self._status.content = f"Opening {name}"
            try:
                opened = open_player(name)
            except (ValueError, OSError) as error:
                self._policy.value = before[0]
                self.server.gui.add_modal(f"Cannot open it: {error}")
            else:
                if opened.env is not player.env:
                    self._add_worlds(opened)
                player = opened
        self.show(player.start(*self._cell()), player)
        return player

    def _add_worlds(self, player: Player) -> None:
        """Show the worlds of a player side by side, in place of those shown before."""
        self._stage = stage_of(player)
        self._views = [
            WorldView(self.server, self._stage, f"/world_{world}") for world in range(player.env.num_envs)
        ]

    def show(self, snapshots: Sequence[Snapshot], player: Player) -> None:
        """Update all worlds and the panel.

        Args:
            snapshots: One per world.
            player: Whose they are.
        """
        assert self._stage is not None
        world = int(self._offered(self._world)) - 1
        with self.server.atomic():
            # The chosen world comes last: the stage then has its pose for the depth image.
            order = [i for i in range(len(snapshots)) if i != world] + [world]
            if self._follow.value:
                self._anchor = snapshots[world].qpos[:2] + _offset(world)
            for i in order:
                self._views[i].update(snapshots[i], np.array(_offset(i)) - self._anchor)
            # Moves along, which an endless pattern shows by its lines only.
            self._floor.position = (*-np.mod(self._anchor, _SECTION_M), 0.0)
        self._depth.image = np.asarray(camera_picture(self._stage, snapshots[world], _DEPTH_ROWS))
        self._depth.label = f"{camera_label(snapshots[world])}; near is bright"
        self._status.content = status_text(snapshots[world])
        self._statistics.content = statistics_text(player.ended)


def status_text(snapshot: Snapshot) -> str:
    """Markdown about the present step of one world."""
    dots, target = snapshot.scandots, snapshot.target
    seen = [] if dots is None else [f"{int(dots.seen.sum())} corners seen"]
    if target is not None:
        seen.append(f"{target.what.kind} {target_label(target)}")
    pan, tilt = (np.degrees(snapshot.joint(name)) for name in ("head_pan", "head_tilt"))
    stage = "" if snapshot.stage is None else f"{snapshot.stage}, "
    return (
        f"**{snapshot.time:.1f} s, {stage}{snapshot.outcome.replace('_', '-')}**, "
        f"{progress_label(snapshot)}"
        f"\n\ncamera pan {pan:.0f}°, tilt {tilt:.0f}°, lift {snapshot.joint('lift'):.2f} m, "
        f"{', '.join(seen)}"
    )


def statistics_text(ended: Sequence[Snapshot]) -> str:
    """Markdown about the episodes that have ended."""
    if not ended:
        return "No episode has ended yet."
    causes = [snapshot.cause.replace("_", "-") for snapshot in ended]
    rows = [
        f"| {cause} | {count} | {count / len(causes):.0%} |" for cause, count in Counter(causes).most_common()
    ]
    times = [snapshot.time for snapshot in ended if snapshot.outcome == "success"]
    mean = f"\n\nMean time of the successes: {np.mean(times):.1f} s" if times else ""
    table = "\n".join([f"| {len(ended)} episodes | | |", "|---|---|---|", *rows])
    return f"{table}{mean}\n\nLast: {causes[-1]}, {ended[-1].time:.1f} s"


def _offset(world: int) -> tuple[float, float]:
    return (0.0, -_SPACING_M * world)


def _check_port(host: str, port: int) -> None:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except socket.gaierror as error:
            raise ConfigError(f"host: {host} is no address: {error.strerror}") from None
        except (OSError, UnicodeError) as error:
            why = error.strerror if isinstance(error, OSError) else "no address"
            raise ConfigError(f"port: cannot listen on {host}:{port}: {why}") from None
