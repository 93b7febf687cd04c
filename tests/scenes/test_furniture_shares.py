"""How often pieces of furniture hang in the room."""

import numpy as np
import pytest
import warp as wp

from spin_rl.scenes.rooms.furniture import BEAM, HANGING_SHARE, PENDANT, draw_piece


@wp.kernel
def _draw(hanging_share: float, kind_out: wp.array(dtype=wp.int32)):
    i = wp.tid()
    kind_out[i] = draw_piece(7, i, hanging_share).kind


def kinds(share, device) -> np.ndarray:
    out = wp.zeros(20_000, dtype=wp.int32, device=device)
    wp.launch(_draw, dim=out.shape, inputs=[share], outputs=[out], device=device)
    return out.numpy()


@pytest.mark.parametrize("share", [0.0, 0.03, 0.3, 0.9, 1.0])
def test_hanging_pieces_are_as_frequent_as_asked(device, share):
    drawn, usual = kinds(share, device), kinds(HANGING_SHARE, device)
    hangs = (drawn == PENDANT) | (drawn == BEAM)
    assert hangs.mean() == pytest.approx(share, abs=0.01)
    if 0.0 < share < 1.0:  # the others share what is left as before
        usual_rest = usual[(usual != PENDANT) & (usual != BEAM)]
        for kind in np.unique(usual):
            if kind not in (PENDANT, BEAM):
                mine, before = (drawn[~hangs] == kind).mean(), (usual_rest == kind).mean()
                assert mine == pytest.approx(before, abs=0.03)


def test_the_usual_share_changes_nothing(device):
    nearly = kinds(float(np.nextafter(np.float32(HANGING_SHARE), np.float32(1.0))), device)
    assert (kinds(HANGING_SHARE, device) == nearly).mean() > 0.999
