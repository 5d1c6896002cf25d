"""The schema of camera paths and what reads them agree."""

import numpy as np
import pytest

from pgm_data.dataset.documents import document_faults
from pgm_models.synthesis.camera_path_file import camera_path_of, camera_path_to_json

PLACED = {"time": 0, "position": [0, -30, 8], "look_at": [0, 0, 1], "fov_deg": 30, "roll_deg": 5}


def document(*keys, **changes):
    return {"width": 64, "height": 36, "keys": list(keys), **changes}


def test_paths_that_are_read_and_written_hold_to_the_schema():
    path = camera_path_of(document(PLACED, {**PLACED, "time": 2.5, "position": [9, -20, 4]}))
    assert not document_faults("camera_path", document(PLACED))
    written = camera_path_to_json(path)
    assert not document_faults("camera_path", written)
    np.testing.assert_allclose(camera_path_of(written).cameras.K, path.cameras.K)


MATRICES = camera_path_to_json(camera_path_of(document(PLACED)))["keys"][0]


@pytest.mark.parametrize(
    "wrong",
    [
        document(),
        document({**PLACED, "time": None}),
        document({"time": 0}),
        document({"time": 0, "position": [0, 0, 1]}),
        document({"time": 0, "look_at": [0, 0, 1]}),
        document({**PLACED, "position": [0, 1]}),
        document({**PLACED, "fov_deg": 180}),
        document({**PLACED, "zoom": 2}),
        document({**PLACED, **MATRICES}),
        document({**MATRICES, "roll_deg": 3}),
        document({name: value for name, value in MATRICES.items() if name != "distortion"}),
        document(PLACED, width=0),
        document(PLACED, height=1.5),
        document(PLACED, depth=1),
        [],
    ],
)
def test_what_the_schema_refuses_is_not_read_either(wrong):
    assert document_faults("camera_path", wrong)
    with pytest.raises(ValueError, match="expected"):
        camera_path_of(wrong)
