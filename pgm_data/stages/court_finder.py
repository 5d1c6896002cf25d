"""First cameras for a picture, best guess first: a person's marks, the network's points, then lines alone."""

from collections.abc import Iterator, Mapping

import numpy as np

from pgm_data.court import Court
from pgm_data.detect.court_lines import LineGuessOptions, guess_homographies
from pgm_data.detect.court_network import CourtNetwork
from pgm_data.lift.court_camera import CourtCamera
from pgm_data.lift.first_camera import FirstOptions, camera_of_homography, camera_of_points
from pgm_data.stages.court_track import Marks
from pgm_data.video import DecodedFrame

SURE_SCORE, LEAST_SCORE = 0.5, 0.2
"""Scores of the network's points that are trusted at first, and when those lead nowhere."""


class CourtFinder:
    """Guesses for one video; knows the frame that is looked at, and how often the slow second opinion was asked."""

    def __init__(
        self,
        court: Court,
        *,
        network: CourtNetwork | None,
        size: tuple[int, int],
        marks: Mapping[int, Marks],
        lines_every: int,
    ) -> None:
        """Start a video.

        Args:
            court: The court.
            network: The court's network; None where there is none, and lines alone must do.
            size: Picture width and height.
            marks: A person's court points, by video frame.
            lines_every: Frames between two guesses from lines alone; 0 for never.
        """
        self.court, self.network, self.size, self.marks = court, network, size, marks
        self.lines_every = lines_every
        self.next_lines = 0
        self.frame: DecodedFrame | None = None

    def new_shot(self) -> None:
        """What was seen before says nothing about this shot: lines may be asked at once."""
        self.next_lines = 0

    def look_at(self, frame: DecodedFrame) -> None:
        """The frame that the next guesses are about."""
        self.frame = frame

    def __call__(self, video_frame: int) -> Iterator[CourtCamera]:
        """First cameras of the current frame, lazily: each costs more than the one before."""
        frame = self.frame
        assert frame is not None and frame.video_frame == video_frame
        options = FirstOptions()
        if video_frame in self.marks:
            marks = self.marks[video_frame]
            found = camera_of_points(marks.points_world, marks.pixels, size=self.size, options=options)
            if found is not None:
                yield found[0]
            return
        if self.network is not None:
            points = self.network.detect(frame.bgr())
            world = self.court.all_world
            for score in (SURE_SCORE, LEAST_SCORE):
                pixels = np.where((points.scores >= score)[:, None], points.pixels, np.nan)
                found = camera_of_points(world, pixels, size=self.size, options=options)
                if found is not None:
                    yield found[0]
        if self.lines_every and video_frame >= self.next_lines:
            self.next_lines = video_frame + self.lines_every
            guesses = guess_homographies(frame.luma, self.court, LineGuessOptions())
            for H in guesses.pixel_from_ground:
                camera = camera_of_homography(H, size=self.size, options=options)
                if camera is not None:
                    yield camera
