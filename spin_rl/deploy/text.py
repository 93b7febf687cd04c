"""A contract in words, for people: what `spin-export show=` prints."""

from __future__ import annotations

from spin_rl.deploy.contract import ABSOLUTE, Contract, Group


def summary(contract: Contract) -> str:
    """Say what a policy reads, does and needs, without its model card."""
    camera, profile = contract.camera, contract.speed_profile
    lines = [
        f"{contract.name}: task {contract.task}, {contract.rate_hz:g} Hz, exported by {contract.program}",
        "",
        "Inputs, each of shape (1, size):",
        *(line for group in contract.observations for line in _group(group)),
        *(
            f"  {name:<16} float32  {'x'.join(map(str, memory.shape))}  the last {memory.next}, "
            f"{memory.initial:g} after a reset"
            for name, memory in contract.state.items()
        ),
        "",
        *_actions(contract),
        "",
        f"Reset: {contract.reset}",
    ]
    view = f"{camera.fov_deg[0]:.1f} degrees up and down, {camera.fov_deg[1]:.1f} across"
    lines.append(
        f"Camera: {camera.mount}, {view}" + ("" if camera.pose is None else f", held at {camera.pose}")
    )
    if camera.image is not None and camera.focal_px is not None:
        rows, columns = camera.image
        focal = f"{camera.focal_px[0]:.1f} x {camera.focal_px[1]:.1f} px"
        levels = "for the pilot alone"
        if camera.range_m is not None:
            levels = f"0 is {camera.range_m[0]:g} m, 255 is {camera.range_m[1]:g} m or a hole"
        lines.append(f"Image: {rows} x {columns} upright, focal length {focal}, {levels}")
    if contract.depth_filter is not None:
        steps = ", ".join(f"{key} {value:g}" for key, value in vars(contract.depth_filter).items())
        lines.append(f"Depth filter: {steps}")
    if contract.scandots is not None:
        known = contract.scandots
        hidden = "hidden ones left out" if known.occlusion else "hidden ones too"
        lines.append(f"Scandots: corners within {known.window_m:g} m, {hidden}")
    if contract.goal is not None:
        far = (
            "as far as it is"
            if contract.goal.range_m is None
            else f"at most {contract.goal.range_m:g} m away"
        )
        lines.append(f"Goal: told {far}, reached within {contract.goal.tolerance_m:g} m")
    lines.append(
        f"Speeds ({profile.name}): {profile.forward_max:g} m/s ahead, {profile.reverse_max:g} back, "
        f"{profile.turn_max:g} rad/s; {profile.base_acceleration:g} m/s^2"
    )
    for name, section in (("Guard", contract.guard), ("Planner", contract.planner)):
        if section is not None and section.enabled:
            values = (f"{key} {value:g}" for key, value in vars(section).items() if key != "enabled")
            lines.append(f"{name}: {', '.join(values)}")
    if contract.simulation_only is not None:
        lines.append(f"SIMULATION ONLY: {contract.simulation_only}")
    if contract.parity is not None:
        parity = contract.parity
        lines.append(
            f"Checked: {parity.steps} steps, {parity.resets} resets, actions within "
            f"{parity.action_error:.1e} of the trained policy's, memory within {parity.state_error:.1e}"
        )
    return "\n".join(lines)


def full_text(contract: Contract) -> str:
    """Say all: the summary, how it was trained, and its model card."""
    training = (f"  {key}: {value}" for key, value in contract.training.items())
    return "\n".join([summary(contract), "", "Training:", *training, "", contract.model_card.strip()])


def _group(group: Group) -> list[str]:
    lines = [f"  {group.name:<16} {group.dtype:<8} {group.size}  from the {group.source}"]
    column = 0
    for term in group.terms:
        for label, scale, bias in zip(term.labels, term.scale, term.bias, strict=True):
            clip = "" if term.clip is None else f", clipped to {term.clip:g}"
            offset = "" if bias == 0.0 else f" {bias:+.4g}"
            lines.append(f"    {column:>3}  {term.name} {label} [{term.unit}] x {scale:.4g}{offset}{clip}")
            column += 1
    return lines


def _actions(contract: Contract) -> list[str]:
    actions = contract.actions
    ahead, back = actions.forward
    lines = [
        f"Actions, {len(contract.action_names)} in [-1, 1], joints {actions.mode}:",
        f"  base_forward     x {ahead:g} m/s, backwards x {back:g} m/s",
        f"  base_turn        x {actions.turn:g} rad/s",
    ]
    for index, joint in enumerate(contract.joint_names):
        low, zero, high = actions.low[index], actions.zero[index], actions.high[index]
        within = f"in [{low:g}, {high:g}]"
        if actions.mode != ABSOLUTE:
            within = f"within {actions.joint_lead[index]:g} of the joint, {within}"
        if actions.mode == ABSOLUTE:
            lines.append(f"  {joint:<16} target {low:g} at -1, {zero:g} at 0, {high:g} at 1")
        elif actions.joint_rate[index] > 0.0:
            lines.append(f"  {joint:<16} target moves by {actions.joint_rate[index]:g} a second, {within}")
        else:
            middle, span = actions.gripper_middle, actions.gripper_span
            lines.append(f"  {joint:<16} target {middle:g} + {span:g} x action, {within}")
    return lines
