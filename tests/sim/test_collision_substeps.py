"""A touch in any substep of a control step counts."""

from sim_worlds import advance, scene_with, simulate


def test_a_touch_that_ends_before_the_last_substep_is_flagged(device):
    # A box against the back of the base by a millimetre; driving off opens the gap within a few substeps.
    touching = scene_with(box=(-0.2865 - 0.1 + 0.001, 0.013, 0.09))
    sim = simulate([touching, scene_with()], device)
    sim.views.action[:, 0] = 1.0
    advance(sim)
    assert sim.views.part_contacts[:, 0].tolist() == [True, False]
    assert float(sim.views.qpos[0, 0]) > 0.002  # clear of the box at the end
    advance(sim)
    assert not sim.views.part_contacts.any()
