"""Graphics over the picture: what they cover is what their boxes say."""

import numpy as np
import pytest

from pgm_data.simulate.pictures.scoreboard import BoardLines, draw_board_style, draw_overlay_of

LINES = BoardLines(sets=((6, 4), (3, 6), (2, 1)), points=("40", "AD"), serving=1)


@pytest.mark.parametrize("size", [(1280, 720), (1920, 1080), (320, 180), (64, 36)])
def test_nothing_outside_of_the_boxes_is_opaque(size: tuple[int, int]) -> None:
    for seed in range(12):
        overlay = draw_overlay_of(draw_board_style(np.random.default_rng(seed)), LINES, size)
        free = overlay.opacity[..., 0] > 0
        for x0, y0, x1, y1 in overlay.boxes:
            assert 0 <= x0 < x1 <= size[0] and 0 <= y0 < y1 <= size[1]
            inside = free[int(y0) : int(y1), int(x0) : int(x1)]
            assert overlay.opacity[int(y0) : int(y1), int(x0) : int(x1)].any()
            inside[:] = False
        assert not free.any()


def test_the_score_is_drawn() -> None:
    style = next(s for s in (draw_board_style(np.random.default_rng(i)) for i in range(50)) if s.board)
    before = draw_overlay_of(style, LINES, (1280, 720))
    after = draw_overlay_of(style, BoardLines(sets=LINES.sets, points=("40", "0"), serving=1), (1280, 720))
    assert (before.paint != after.paint).any()
