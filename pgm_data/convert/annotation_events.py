"""Events that people marked with annotation programs, told apart by their files.

A label that holds one of the words hit, bounce, net, first, last marks that event; all other labels are passed over. A
point or box of a bounce, or of a label that also holds the word ground, is where the ball's vertical projection is (of
a box: the middle of its lower edge); any other point is the ball in the air and places nothing on the ground.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from pgm_data.ball import BallEvents
from pgm_data.convert.cvat_events import read_cvat_marks
from pgm_data.convert.events_csv import events_of_marks, read_events_csv
from pgm_data.convert.label_studio_events import read_label_studio_marks

READERS = {".xml": read_cvat_marks, ".json": read_label_studio_marks}


def read_events(
    path: Path,
    times: Float[np.ndarray, " frames"],
    *,
    first_frame: int = 0,
    size: tuple[int, int] | None = None,
) -> BallEvents:
    """The events of an EVENTS.csv, a CVAT export (.xml) or a Label Studio export (.json), by a person.

    Args:
        path: The file.
        times: Capture times of the clip's frames, s.
        first_frame: Frame of the video that the clip begins with.
        size: Width and height of the picture, px, where it is known.

    Raises:
        ValueError: If the file is of another kind, or is not what it must be; the message names file, place and field.
    """
    suffix = path.suffix.lower()
    if suffix in READERS:
        return events_of_marks(READERS[suffix](path, size), times, first_frame=first_frame, size=size)
    if suffix in (".csv", ".tsv", ".txt"):
        return read_events_csv(path, times, first_frame=first_frame, size=size)
    raise ValueError(
        f"{path}: expected events in a .csv, .xml (CVAT) or .json (Label Studio), got {suffix or 'no suffix'}"
    )
